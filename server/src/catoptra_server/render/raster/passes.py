"""What a view is made of: passes in order, each from textures of earlier ones into a target."""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.raster.shader_programs import Definitions, ProgramSpec, ShaderPrograms

# Linear light between passes: 11 significant bits are 0.03 grey levels at most, light above 1
# survives until it is averaged, and on llvmpipe the faces are drawn no slower than into an sRGB
# target of 8 bits (tests/measurements/raster_faces.py), which would lose both.
LINEAR_DTYPE = "f2"

# What a pass that can do both writes: sRGB, or the linear light that effects change.
ENCODED: Definitions = ()
LINEAR: Definitions = (("LINEAR", 1),)


class Pass(Protocol):
    """One drawing step of a view; `name` is its stage in the frame's timings."""

    @property
    def name(self) -> str:
        """Return the name of the stage."""

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target."""

    def close(self) -> None:
        """Free what the pass holds beside its target."""


class AveragePass:
    """The mean of samples x samples texels of a linear picture. encoding: ENCODED or LINEAR."""

    name = "average"

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        image: moderngl.Texture,
        samples: int,
        target: moderngl.Framebuffer,
        *,
        encoding: Definitions = ENCODED,
    ) -> None:
        self._context = context
        self._image = image
        self._target = target
        define = (("SAMPLES", samples), *encoding)
        program = programs.get(ProgramSpec("fullscreen_triangle", "average", define))
        self._fullscreen_triangle = context.vertex_array(program, [])

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target: every pixel is written, so nothing is cleared."""
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._image.use(0)
        self._fullscreen_triangle.render(vertices=3)

    def close(self) -> None:
        """Free the vertex array."""
        self._fullscreen_triangle.release()


class OutputImage:
    """The finished picture on the device, RGB without alpha, and its way back."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        self._colour = context.renderbuffer((width, height), 3)
        self.target = context.framebuffer([self._colour])

    def read(self) -> npt.NDArray[np.uint8]:
        """Return the picture as a read-only (h, w, 3) array of its own.

        Nothing is flipped here or anywhere: all passes draw the top of the picture into row 0,
        which OpenGL calls the bottom and reads first. A later frame does not touch the array.
        """
        width, height = self.target.size
        image = np.empty((height, width, 3), dtype=np.uint8)
        self.target.read_into(image, components=3, alignment=1)
        image.setflags(write=False)
        return image

    def close(self) -> None:
        """Free the target."""
        self.target.release()
        self._colour.release()
