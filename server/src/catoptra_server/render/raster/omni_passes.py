"""The passes of an omnidirectional view: which are needed, and their targets.

Faces and lookup map exist for every frame. The passes behind them depend on effects and shutter,
which may differ from frame to frame: a frame has only the passes that its effects need. Image
effects themselves have no pass: they are applied to the exposure that is read back.
"""

from __future__ import annotations

import moderngl

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.raster.accumulation_pass import AccumulationPass
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.mirror_mesh_lookup import render_lookup_texture
from catoptra_server.render.raster.mirror_pass import MirrorPass, make_lookup_texture
from catoptra_server.render.raster.pass_sequence import ExposureTarget, PassSequence
from catoptra_server.render.raster.passes import ENCODED, LINEAR, OutputImage, Pass
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.raster.shader_programs import Definitions, ShaderPrograms
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.robot.render_settings import PerPixel


@dataclass(frozen=True, slots=True, eq=False)
class OmniPasses:
    """Builds the pass sequences of one omnidirectional view."""

    context: moderngl.Context
    """OpenGL context."""
    programs: ShaderPrograms
    """Shader programs of the context."""
    scene: SceneBuffers
    """Scene on the device."""
    camera: OmniCamera
    """Camera model of the image."""
    plan: RenderPlan
    """Samples and surface of the mirror."""
    faces: FacePass[Atlas]
    """First pass of every sequence."""
    lookup_map: moderngl.Texture
    """Atlas coordinates of the image's samples."""
    output: OutputImage
    """Finished image."""

    def make_plain(self) -> PassSequence:
        """Faces and mirror, encoded at once."""
        return PassSequence((self.faces, self._make_mirror_pass(self.output.target, ENCODED)))

    def make_long_exposure(self) -> PassSequence:
        """Faces and mirror accumulated in linear light, then encoded."""
        exposed = self.make_exposure(has_ranges=False, has_shutter=True)
        return exposed.append_encoding(self.context, self.programs, self.output.target)

    def make_exposure(self, *, has_ranges: bool, has_shutter: bool) -> PassSequence:
        """Faces and mirror in linear light, to be read back, with ranges or without."""
        ranges = self._make_range_pass() if has_ranges else None
        image = LinearImageTarget(self.context, self.camera.width_px, self.camera.height_px)
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

    def _make_sharp_passes(self, target: moderngl.Framebuffer) -> tuple[Pass, Pass]:
        """Faces and mirror of one instant, in linear light."""
        return self.faces, self._make_mirror_pass(target, LINEAR)

    def _make_accumulation(self, target: moderngl.Framebuffer) -> tuple[Pass]:
        """One pass that accumulates sharp images in a target of its own."""
        # The accumulation reads one image while it adds to the other.
        sharp = LinearImageTarget(self.context, self.camera.width_px, self.camera.height_px)
        sharp_passes = self._make_sharp_passes(sharp.target)
        accumulation = AccumulationPass(
            self.context, self.programs, self.camera, sharp_passes, sharp, target
        )
        return (accumulation,)

    def _make_mirror_pass(self, target: moderngl.Framebuffer, encoding: Definitions) -> MirrorPass:
        """Mirror pass into a target, encoded or linear."""
        return MirrorPass(
            self.context,
            self.programs,
            self.faces,
            self.camera,
            self.lookup_map,
            self.plan.samples,
            target,
            encoding=encoding,
        )

    def _make_range_pass(self) -> RangePass:
        """Pass that measures the range of each pixel."""
        # One sample a pixel, at the pixel's centre: effects use the range of the centre.
        lookup_map = make_lookup_map(
            self.context, self.programs, self.camera, self.plan, self.faces.atlas, samples=1
        )
        return RangePass(
            self.context, self.programs, self.scene, self.faces.atlas, self.camera, lookup_map
        )


def make_lookup_map(
    context: moderngl.Context,
    programs: ShaderPrograms,
    camera: OmniCamera,
    plan: RenderPlan,
    atlas: Atlas,
    *,
    samples: int,
) -> moderngl.Texture:
    """Lookup map of the camera model or of the plan's mirror mesh."""
    if isinstance(plan.surface, PerPixel):
        return make_lookup_texture(context, camera, atlas, samples)
    return render_lookup_texture(context, programs, camera, plan.surface, samples, atlas)
