"""A long exposure on the device: sharp images, rendered in turn and added up."""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.passes import Pass, image_bytes
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms, set_sampler
from catoptra_server.render.time_samples import sample_shutter
from catoptra_server.world.camera_state import CameraState, RowWeights


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
