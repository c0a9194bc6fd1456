"""The raster renderer: OpenGL 3.3 core on EGL, without a window. The only door to moderngl.

Import it only where OpenGL is wanted: `choice.py` does so on demand.
"""

from catoptra_server.render.raster.gl_device import OpenGLMissingError, open_device
from catoptra_server.render.raster.raster_renderer import RasterRenderer

__all__ = ["OpenGLMissingError", "RasterRenderer", "open_device"]
