"""An OpenGL context without a window, and the identity of the device behind it.

EGL is loaded by the names of its runtime libraries: the bare names that moderngl looks for by
default exist only with development packages.
"""

from __future__ import annotations

import ctypes
from typing import Any

import moderngl

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.slotted_dataclass import dataclass

EGL_LIBRARY = "libEGL.so.1"
GL_LIBRARY = "libGL.so.1"
# Debian's names; the last one is Mesa's drivers, without which EGL finds no device.
PACKAGES = "libgl1 libegl1 libgl1-mesa-dri"
# 3.3 core: the oldest version with integer arithmetic, texelFetch and multisampled textures; Mesa's
# software drivers have it too.
REQUIRED_VERSION = 330

_CONTEXT_SETTINGS: dict[str, Any] = {"backend": "egl", "libgl": GL_LIBRARY, "libegl": EGL_LIBRARY}

# Names in GL_RENDERER of drivers that render on the processor.
_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "software")


class OpenGLMissingError(RendererUnavailableError):
    """OpenGL 3.3 is unavailable; the text names the reason and the packages that bring OpenGL."""

    def __init__(self, reason: str) -> None:
        """Compose the message from a reason: a clause for a log line, kept as `reason`."""
        super().__init__(
            f"the raster renderer cannot run: {reason}. On Debian and Ubuntu install "
            f"{PACKAGES}, or use the trace renderer, which needs none of them"
        )
        self.reason = reason


@dataclass(frozen=True, slots=True, eq=False)
class GlDevice:
    """An OpenGL context and the names of its driver."""

    context: moderngl.Context
    """OpenGL context, bound to one thread."""
    vendor: str
    """GL_VENDOR of the driver."""
    renderer: str
    """GL_RENDERER of the driver."""
    version: str
    """GL_VERSION of the driver."""

    @property
    def is_software(self) -> bool:
        """Whether the driver renders on the processor."""
        return any(name in self.renderer.lower() for name in _SOFTWARE_RENDERERS)

    def __str__(self) -> str:
        return f"{self.renderer}, {self.vendor}, OpenGL {self.version}"

    def close(self) -> None:
        """Free the context with all its resources."""
        self.context.release()


def open_device() -> GlDevice:
    """Open a headless OpenGL 3.3 device.

    The context is bound to the calling thread from here on.

    Raises:
        OpenGLMissingError: A library is missing, or EGL offers no OpenGL 3.3 context.
    """
    for library in (EGL_LIBRARY, GL_LIBRARY):
        _require_library(library)
    try:
        context = moderngl.create_context(
            require=REQUIRED_VERSION, standalone=True, **_CONTEXT_SETTINGS
        )
    except Exception as error:  # the C extension raises bare Exception, and ValueError for too old
        raise OpenGLMissingError(f"EGL offers no OpenGL 3.3 context ({error})") from error
    info = context.info
    return GlDevice(context, info["GL_VENDOR"], info["GL_RENDERER"], info["GL_VERSION"])


def _require_library(library: str) -> None:
    """Raise OpenGLMissingError unless a shared library loads."""
    try:
        # moderngl reports a missing library as a bare exception without the file's name, so each
        # library is loaded here first.
        ctypes.CDLL(library)
    except OSError as error:
        raise OpenGLMissingError(f"{library} cannot be loaded ({error})") from error
