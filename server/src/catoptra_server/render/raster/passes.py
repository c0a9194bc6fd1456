"""The passes of a view: each renders from textures of earlier passes into a target."""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_server.render.raster.shader_programs import Definitions, ProgramSpec, ShaderPrograms
from catoptra_server.world.camera_state import CameraState

# Linear light between passes: 11 significant bits are 0.03 grey levels at most, and light above 1
# is kept until the samples are averaged. An sRGB target of 8 bits would lose both, and on llvmpipe
# the faces render no faster into one (tests/measurements/raster_faces.py).
LINEAR_DTYPE = "f2"

# Output of passes that have both: sRGB, or the linear light that effects change and exposures add.
ENCODED: Definitions = ()
LINEAR: Definitions = (("LINEAR", 1),)


class Pass(Protocol):
    """One rendering step of a view."""

    @property
    def name(self) -> str:
        """Name of the stage in the frame's timings."""

    @property
    def memory_bytes(self) -> int:
        """Size of the pass's own textures and buffers."""

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target."""

    def close(self) -> None:
        """Free the pass's resources; the target belongs to its creator."""


def image_bytes(*images: moderngl.Texture | moderngl.Renderbuffer) -> int:
    """Size of images on the device, by their formats: drivers may pad them."""
    return sum(
        image.width
        * image.height
        * max(image.samples, 1)
        * image.components
        # Types are named by kind and bytes, such as f2; depths have four.
        * int(image.dtype[-1])
        for image in images
    )


class AveragePass:
    """The mean of samples x samples texels of a linear image, for each pixel."""

    memory_bytes = 0

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        image: moderngl.Texture,
        samples: int,
        target: moderngl.Framebuffer,
        *,
        encoding: Definitions = ENCODED,
        name: str = "average",
    ) -> None:
        """Prepare the program for a number of samples and an encoding: ENCODED or LINEAR."""
        self.name = name
        self._context = context
        self._image = image
        self._target = target
        definitions = (("SAMPLES", samples), *encoding)
        program = programs.get(ProgramSpec("fullscreen_triangle", "average", definitions))
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
    """The finished image on the device, RGB without alpha, and its readback."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        self._colour = context.renderbuffer((width, height), 3)
        self.target = context.framebuffer([self._colour])

    @property
    def memory_bytes(self) -> int:
        """Size of the image."""
        return image_bytes(self._colour)

    def read(self) -> npt.NDArray[np.uint8]:
        """Read the image back as a read-only (h, w, 3) array.

        Nothing is flipped here or anywhere: all passes draw the top of the image into row 0, which
        OpenGL calls the bottom and reads first. A later frame does not touch the array.
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
