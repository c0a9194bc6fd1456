"""An OpenGL context without a window, and what it says about the device behind it.

EGL is asked for by its runtime library names, because the bare names that moderngl would look for
exist only with development packages.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import moderngl

from catoptra_protocol.errors import RendererUnavailableError

EGL_LIBRARY = "libEGL.so.1"
GL_LIBRARY = "libGL.so.1"
PACKAGES = "libgl1 libegl1 libgl1-mesa-dri"
REQUIRED_VERSION = 330

_CONTEXT_SETTINGS: dict[str, Any] = {"backend": "egl", "libgl": GL_LIBRARY, "libegl": EGL_LIBRARY}

# How the drivers that draw on the processor call themselves in GL_RENDERER.
_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "software")


class OpenGLMissingError(RendererUnavailableError):
    """Say why there is no OpenGL (`what`, a clause for a log line) and which packages bring it."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"the raster renderer cannot run: {reason}. On Debian and Ubuntu install "
            f"{PACKAGES}, or draw with the trace renderer, which needs none of them"
        )
        self.reason = reason


@dataclass(frozen=True, slots=True, eq=False)
class GlDevice:
    """A context of one's own, and the names that its driver goes by."""

    context: moderngl.Context
    vendor: str
    renderer: str
    version: str

    @property
    def is_software(self) -> bool:
        """Return whether OpenGL is emulated on the processor."""
        return any(name in self.renderer.lower() for name in _SOFTWARE_RENDERERS)

    def __str__(self) -> str:
        return f"{self.renderer}, {self.vendor}, OpenGL {self.version}"

    def close(self) -> None:
        """Free the context and all that lives in it."""
        self.context.release()


def open_device() -> GlDevice:
    """Return a headless OpenGL 3.3 device. Raises OpenGLMissingError where there is none.

    The context belongs to the calling thread from here on.
    """
    for library in (EGL_LIBRARY, GL_LIBRARY):
        _require_library(library)
    try:
        context = moderngl.create_context(
            require=REQUIRED_VERSION, standalone=True, **_CONTEXT_SETTINGS
        )
    except Exception as error:  # the C extension raises bare Exception, and ValueError for too old
        raise OpenGLMissingError(f"EGL gives no OpenGL 3.3 context ({error})") from error
    info = context.info
    return GlDevice(context, info["GL_VENDOR"], info["GL_RENDERER"], info["GL_VERSION"])


def _require_library(library: str) -> None:
    try:
        ctypes.CDLL(library)
    except OSError as error:
        raise OpenGLMissingError(f"{library} cannot be loaded ({error})") from error
