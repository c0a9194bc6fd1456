"""Passes in order: to a finished image, or to an exposure that is read back before its effects.

The passes of an omnidirectional view: which are needed, and their targets.

Faces and lookup map exist for every frame. The passes behind them depend on effects and shutter,
which may differ from frame to frame: a frame has only the passes that its effects need. Image
effects themselves have no pass: they are applied to the exposure that is read back.

The passes of a perspective view: one face, and the mean of its samples.

OpenGL projects the image by itself, so there is no lookup: the face has the samples of the image.

Prepared cameras: passes in order, timed, and the readback of the image.

A frame with image effects is read back in linear light, and an image changer does the rest: on
llvmpipe the kernel's stages are several times as fast as the same formulas were as shaders, leave
out cells in which nobody sees an effect, and measure each effect's largest change, while the
readback takes less than a millisecond. No graphics processor has been measured.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import CaptureContext, ImageEffect
from catoptra_server.render.image_changer import ExposedImage, ImageChanger
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.frustum import LensProjection
from catoptra_server.render.raster.device import Definitions, GlDevice, ShaderPrograms
from catoptra_server.render.raster.face_pass import DrawCounts, FacePass
from catoptra_server.render.raster.mirror_pass import (
    MirrorPass,
    make_lookup_texture,
    render_lookup_texture,
)
from catoptra_server.render.raster.passes import (
    ENCODED,
    LINEAR,
    AccumulationPass,
    AveragePass,
    LinearImageTarget,
    OutputImage,
    Pass,
    image_bytes,
)
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.render_settings import PerPixel
from catoptra_server.render.renderer import (
    NO_THRESHOLDS,
    LinearImage,
    RenderedImage,
    RenderPlan,
    StageClock,
)
from catoptra_server.world.camera_state import CameraState


@dataclass(frozen=True, slots=True, eq=False)
class ExposureTarget:
    """An exposure in linear light, on the device."""

    image: LinearImageTarget
    """Linear light before all image effects."""
    ranges: RangePass | None
    """Ranges of the pixels, None where no effect uses them."""

    def read(self) -> tuple[LinearImage, npt.NDArray[np.float32] | None]:
        """Read back (h, w, 3) light and (h, w) ranges, metres."""
        return self.image.read(), self.ranges.read() if self.ranges else None


@dataclass(frozen=True, slots=True, eq=False)
class PassSequence:
    """The passes from the faces to an image; the faces are freed with their view."""

    passes: tuple[Pass, ...]
    """Passes in order of rendering."""
    exposure: ExposureTarget | None = None
    """Linear light; None where the only pass behind the faces encodes by itself."""

    def append_encoding(
        self, context: moderngl.Context, programs: ShaderPrograms, target: moderngl.Framebuffer
    ) -> PassSequence:
        """Same sequence of an exposure, with a last pass that encodes the image into a target."""
        assert self.exposure is not None, "the last pass encodes already"
        image = self.exposure.image.texture
        encode = AveragePass(context, programs, image, 1, target, name="encode")
        return PassSequence((*self.passes, encode), self.exposure)

    @property
    def memory_bytes(self) -> int:
        """Size of the images of all passes, without the faces."""
        passes = (one for one in self.passes if not isinstance(one, FacePass))
        exposure = self.exposure.image.memory_bytes if self.exposure else 0
        return sum(one.memory_bytes for one in passes) + exposure

    def close(self) -> None:
        """Free the passes, and the images between them."""
        for render_pass in reversed(self.passes):
            if not isinstance(render_pass, FacePass):
                render_pass.close()
        if self.exposure is not None:
            self.exposure.image.close()


class SequenceFactory(Protocol):
    """Builds the sequences of one view; a sequence is freed with its resources."""

    def make_plain(self) -> PassSequence:
        """Sequence to the finished image without linear light."""

    def make_long_exposure(self) -> PassSequence:
        """Sequence of a long exposure to the finished image."""

    def make_exposure(self, *, has_ranges: bool, has_shutter: bool) -> PassSequence:
        """Sequence to an exposure that is read back, with ranges or without."""


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


# Whether the device encodes the image; whether there are ranges; whether there is a shutter.
SequenceKey = tuple[bool, bool, bool]


class RasterOmniView:
    """A camera: faces, a mirror's lookup map, and the sequences of passes that frames needed."""

    def __init__(
        self,
        device: GlDevice,
        faces: FacePass[Atlas] | FacePass[LensProjection],
        lookup_map: moderngl.Texture | None,
        output: OutputImage,
        *,
        camera: RadialCamera,
        sequences: SequenceFactory,
        image_changer: ImageChanger,
        thread: int,
    ) -> None:
        """Take over faces, lookup map and output, which are freed with the view.

        Args:
            device: Device that renders.
            faces: Face pass of the camera.
            lookup_map: Atlas coordinates of the image's samples; None for a lens.
            output: Finished image.
            camera: Camera model, for the effects.
            sequences: Builds each sequence of passes at its first use.
            image_changer: Applies image effects to exposures that are read back.
            thread: Identifier of the only thread that may use the view.
        """
        self._device = device
        self._faces = faces
        self._lookup_map = lookup_map
        self._output = output
        self._camera = camera
        self.sequences = sequences
        """Builds the sequences of passes."""
        self._image_changer = image_changer
        self._thread = thread
        # All stay ready, six at most: a robot that stops and goes near a wall builds none anew.
        # Ranges take a quarter of a second to build on two cores, and hold 20 MB at 640 px.
        self._sequences: dict[SequenceKey, PassSequence] = {}
        self._last: PassSequence | None = None

    @property
    def pass_names(self) -> tuple[str, ...]:
        """Names of the last frame's passes."""
        return tuple(render_pass.name for render_pass in self.active_passes)

    @property
    def active_passes(self) -> tuple[Pass, ...]:
        """The last frame's passes."""
        return self._last.passes if self._last else ()

    @property
    def memory_bytes(self) -> int:
        """Size of all images on the device."""
        return (
            self._faces.memory_bytes
            + (image_bytes(self._lookup_map) if self._lookup_map else 0)
            + self._output.memory_bytes
            + sum(sequence.memory_bytes for sequence in self._sequences.values())
        )

    @property
    def face_counts(self) -> DrawCounts:
        """Cost of the last frame's faces."""
        return self._faces.counts

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            clock = StageClock(context.finish)
            if effects:
                exposed = self._expose(camera_state, effects, clock)
                encoded = self._image_changer.encode(exposed, effects, thresholds)
                stage_ms = clock.stage_ms | encoded.stage_ms
                return RenderedImage(encoded.image, stage_ms, encoded.changes)
            # Without effects and shutter the pass after the faces encodes by itself: no float image
            # is written and read.
            sequence = self._find_sequence((True, False, camera_state.shutter is not None))
            self._run(sequence, camera_state, clock)
            image = self._output.read()
            clock.end_stage("readback")
        return RenderedImage(image, clock.stage_ms)

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            exposed = self._expose(camera_state, effects, StageClock(context.finish))
            return self._image_changer.change(exposed, effects, NO_THRESHOLDS).image

    def _expose(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...], clock: StageClock
    ) -> ExposedImage:
        """Read one exposure back, before its image effects."""
        has_ranges = any(effect.needs_range for effect in effects)
        sequence = self._find_sequence((False, has_ranges, camera_state.shutter is not None))
        self._run(sequence, camera_state, clock)
        assert sequence.exposure is not None, "an exposed sequence has an image to read"
        light, range_m = sequence.exposure.read()
        clock.end_stage("readback")
        context = CaptureContext(camera_state.noise_seed, range_m=range_m)
        return ExposedImage(light, self._camera, context)

    def _run(self, sequence: PassSequence, camera_state: CameraState, clock: StageClock) -> None:
        """Draw all passes of a sequence, timing each."""
        self._last = sequence
        for render_pass in sequence.passes:
            render_pass.draw(camera_state)
            clock.end_stage(render_pass.name)

    def prepare_plain(self) -> None:
        """Build the passes of frames without effects ahead of the first frame."""
        with self._device.context:
            self._find_sequence((True, False, False))

    def _find_sequence(self, key: SequenceKey) -> PassSequence:
        """Sequence of a kind, built at the first call."""
        if key not in self._sequences:
            self._sequences[key] = self._make_sequence(key)
        return self._sequences[key]

    def _make_sequence(self, key: SequenceKey) -> PassSequence:
        is_encoded, has_ranges, has_shutter = key
        if not is_encoded:
            return self.sequences.make_exposure(has_ranges=has_ranges, has_shutter=has_shutter)
        return self.sequences.make_long_exposure() if has_shutter else self.sequences.make_plain()

    def close(self) -> None:
        """Free the view's resources on the device."""
        with self._device.context:
            for sequence in self._sequences.values():
                sequence.close()
            self._faces.close()
            if self._lookup_map is not None:
                self._lookup_map.release()
            self._output.close()
