"""The exact renderer: one ray a sample through Embree, on the CPU.

Only this package imports embreex.
"""

from catoptra_server.render.trace.trace_renderer import TraceRenderer

__all__ = ["TraceRenderer"]
