"""The passes of a view, and the images that they draw into.

Each pass renders from textures of earlier passes into a target: the mean of samples, a long
exposure as sharp images that are added up. Images are in linear light until the last pass encodes;
`OutputImage` and `LinearImageTarget` are read back.
"""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.render.raster.device import (
    Definitions,
    ProgramSpec,
    ShaderPrograms,
    set_sampler,
)
from catoptra_server.render.renderer import LinearImage, sample_shutter
from catoptra_server.world.objects import CameraState, RowWeights

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


class LinearImageTarget:
    """A float32 image on the device: a texture to read, a framebuffer to draw into."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        self.texture = context.texture((width, height), 4, dtype="f4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.target = context.framebuffer([self.texture])

    @property
    def memory_bytes(self) -> int:
        """Size of the texture."""
        return image_bytes(self.texture)

    def read(self) -> LinearImage:
        """Read the image back as an (h, w, 3) array."""
        width, height = self.texture.size
        data = self.target.read(components=3, dtype="f4", alignment=1)
        return np.frombuffer(data, dtype=np.float32).reshape(height, width, 3)

    def close(self) -> None:
        """Free texture and framebuffer."""
        self.target.release()
        self.texture.release()


class AccumulationPass:
    """From the scene to the mean light of an exposure."""

    name = "accumulate"

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        camera: RadialCamera,
        sharp_passes: tuple[Pass, Pass],
        image: LinearImageTarget,
        target: moderngl.Framebuffer,
    ) -> None:
        """Prepare the additive blending of sharp images.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            camera: Camera, whose rows have a weight each.
            sharp_passes: Face pass and image pass of one time sample. The image pass is freed
                with this pass, the face pass with its view.
            image: Target of the image pass, freed with this pass.
            target: Target of the accumulated light.
        """
        self._context = context
        self._faces, self._image_pass = sharp_passes
        self._image = image
        self._target = target
        self._columns, self._rows = camera.width_px, camera.height_px
        self._program = programs.get(ProgramSpec("fullscreen_triangle", "weighted_accumulate"))
        self._fullscreen_triangle = context.vertex_array(self._program, [])
        # One texel a row: with a rolling shutter each row has weights of its own.
        self._weights = context.texture((1, self._rows), 1, dtype="f4")
        self._weights.filter = (moderngl.NEAREST, moderngl.NEAREST)

    @property
    def memory_bytes(self) -> int:
        """Size of the sharp image and of the row weights."""
        return self._image.memory_bytes + image_bytes(self._weights)

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target."""
        self._target.clear()
        for sharp_state, weights in sample_shutter(camera_state, self._rows):
            # Camera and objects move between time samples, so the faces are rendered anew; the
            # lookup map, fixed to the mirror, stays.
            self._faces.draw(sharp_state)
            self._limit_rows(weights)
            self._image_pass.draw(sharp_state)
            self._weights.write(weights.tobytes())
            self._accumulate()
            # At once: OpenGL's scissor would limit the clearing of the faces as well, and effects
            # behind this pass draw whole images into the same target.
            for target in (self._image.target, self._target):
                target.scissor = None  # type: ignore[assignment] # None resets, says moderngl

    def _limit_rows(self, weights: RowWeights) -> None:
        """Draw the rows alone that a time sample is weighed in."""
        # With a rolling shutter each time sample is seen in a band of rows: all bands together
        # cost little more than one image. Measured in tests/measurements/effect_frame_times.py.
        rows = np.flatnonzero(weights)
        band = (0, int(rows[0]), self._columns, int(rows[-1] - rows[0]) + 1)
        self._image.target.scissor = self._target.scissor = band

    def _accumulate(self) -> None:
        """Add the sharp image, times the weight of each row, to the target."""
        # Both factors are one: the shader has already multiplied the weights, which sum to one in
        # each row.
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE
        self._target.use()
        set_sampler(self._program, "weights", 1)
        self._image.texture.use(0)
        self._weights.use(1)
        self._fullscreen_triangle.render(vertices=3)
        self._context.enable_only(moderngl.NOTHING)

    def close(self) -> None:
        """Free the pass's resources."""
        self._image_pass.close()
        self._fullscreen_triangle.release()
        self._weights.release()
        self._image.close()
