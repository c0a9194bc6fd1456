"""The raster renderer: OpenGL 3.3 core on EGL, without a window.

Only this package imports moderngl. Import the package on demand, as `frames/renderers.py`
does: a machine without OpenGL runs the server with the trace renderer. Raster has been measured
with Mesa's software drivers only, never on a graphics processor.
"""

from catoptra_server.render.raster.device import OpenGLMissingError, open_device
from catoptra_server.render.raster.raster_renderer import RasterRenderer

__all__ = ["OpenGLMissingError", "RasterRenderer", "open_device"]
