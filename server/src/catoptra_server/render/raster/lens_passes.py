"""The passes of a perspective view: one face, and the mean of its samples.

OpenGL projects the image by itself, so there is no lookup: the face has the samples of the image.
"""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.projection.lens_projection import LensProjection
from catoptra_server.render.raster.accumulation_pass import AccumulationPass
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.pass_sequence import ExposureTarget, PassSequence
from catoptra_server.render.raster.passes import ENCODED, LINEAR, AveragePass, OutputImage, Pass
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.raster.shader_programs import Definitions, ShaderPrograms


@dataclass(frozen=True, slots=True, eq=False)
class LensPasses:
    """Builds the pass sequences of one perspective view."""

    context: moderngl.Context
    """OpenGL context."""
    programs: ShaderPrograms
    """Shader programs of the context."""
    scene: SceneBuffers
    """Scene on the device."""
    projection: LensProjection
    """Camera, samples and rotation of the image."""
    faces: FacePass[LensProjection]
    """First pass of every sequence."""
    output: OutputImage
    """Finished image."""

    def make_plain(self) -> PassSequence:
        """Face and mean, encoded at once."""
        return PassSequence((self.faces, self._make_average(self.output.target, ENCODED)))

    def make_long_exposure(self) -> PassSequence:
        """Face and mean accumulated in linear light, then encoded."""
        exposed = self.make_exposure(has_ranges=False, has_shutter=True)
        return exposed.append_encoding(self.context, self.programs, self.output.target)

    def make_exposure(self, *, has_ranges: bool, has_shutter: bool) -> PassSequence:
        """Face and mean in linear light, to be read back, with ranges or without."""
        ranges = self._make_range_pass() if has_ranges else None
        image = LinearImageTarget(self.context, self._camera.width_px, self._camera.height_px)
        passes = self._make_exposure_passes(image.target, ranges, has_shutter)
        return PassSequence(passes, exposure=ExposureTarget(image, ranges))

    def _make_exposure_passes(
        self, target: moderngl.Framebuffer, ranges: RangePass | None, has_shutter: bool
    ) -> tuple[Pass, ...]:
        """Passes of an exposure before its image effects."""
        make_image_passes = self._make_accumulation if has_shutter else self._make_sharp_passes
        # Ranges belong to the pose in the middle of the exposure, as in trace: effects by depth use
        # one range a pixel, not one for each time sample.
        range_passes = () if ranges is None else (ranges,)
        return (*make_image_passes(target), *range_passes)

    @property
    def _camera(self) -> PerspectiveCamera:
        return self.projection.camera

    def _make_sharp_passes(self, target: moderngl.Framebuffer) -> tuple[Pass, Pass]:
        """Face and mean of one instant, in linear light."""
        return self.faces, self._make_average(target, LINEAR)

    def _make_accumulation(self, target: moderngl.Framebuffer) -> tuple[Pass]:
        """One pass that accumulates sharp images in a target of its own."""
        sharp = LinearImageTarget(self.context, self._camera.width_px, self._camera.height_px)
        passes = self._make_sharp_passes(sharp.target)
        return (AccumulationPass(self.context, self.programs, self._camera, passes, sharp, target),)

    def _make_average(self, target: moderngl.Framebuffer, encoding: Definitions) -> AveragePass:
        """Mean of each pixel's samples into a target, encoded or linear."""
        return AveragePass(
            self.context,
            self.programs,
            self.faces.texture,
            self.projection.samples,
            target,
            encoding=encoding,
        )

    def _make_range_pass(self) -> RangePass:
        """Pass that measures the range of each pixel."""
        # One sample a pixel, at the pixel's centre: effects use the range of the centre.
        projection = LensProjection(self._camera, 1, self.projection.mirror_from_camera)
        return RangePass(
            self.context,
            self.programs,
            self.scene,
            projection,
            self._camera,
            self._make_identity_map(),
        )

    def _make_identity_map(self) -> moderngl.Texture:
        """Lookup map that gives each pixel the texel of its own place."""
        size = (self._camera.width_px, self._camera.height_px)
        coordinates = (pixel_sample_positions(self._camera)[:, :, 0] / size).astype(np.float32)
        texture = self.context.texture(size, 2, coordinates.tobytes(), dtype="f4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture
