"""The exact renderer: one ray a sample, on the CPU."""

from catoptra_server.render.trace.trace_renderer import TraceRenderer

__all__ = ["TraceRenderer"]
