"""Prepared cameras: the passes of a frame in order, timed, and the readback of the image.

Faces and lookup map exist for every frame. The passes behind them depend on ranges and shutter,
which may differ from frame to frame: a frame has only the passes that it needs, each built at its
first use. A mirror's image looks up its samples in the faces; a perspective image is one face with
the samples of the image, whose mean is taken.

Image effects have no pass. A frame with effects is read back in linear light, less than a
millisecond on llvmpipe, and an image changer does the rest: the kernel's stages are several times
as fast there as the same formulas were as shaders, leave out cells in which nobody sees an effect,
and measure each effect's largest change. No graphics processor has been measured.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import CaptureContext, ImageEffect, LightSource, Threshold
from catoptra_server.render.image_changer import ExposedImage, ImageChanger, narrow_thresholds
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.frustum import LensProjection
from catoptra_server.render.raster.device import Definitions, GlDevice, ShaderPrograms
from catoptra_server.render.raster.face_pass import DrawCounts, FacePass
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
from catoptra_server.render.renderer import (
    NO_THRESHOLDS,
    LinearImage,
    RenderedImage,
    StageClock,
)
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Light

# Whether the device encodes the image; whether there are ranges; whether there is a shutter.
_SequenceKey = tuple[bool, bool, bool]


class RasterView:
    """A camera, and the sequences of passes that its frames needed so far."""

    def __init__(
        self, device: GlDevice, passes: ViewPasses, image_changer: ImageChanger, *, thread: int
    ) -> None:
        """Take over faces, lookup map and output of the passes, which are freed with the view.

        Args:
            device: Device that renders.
            passes: Builds each sequence of passes at its first use.
            image_changer: Applies image effects to exposures that are read back.
            thread: Identifier of the only thread that may use the view.
        """
        self._device = device
        self._passes = passes
        self._image_changer = image_changer
        self._thread = thread
        # All stay ready, six at most: a robot that stops and goes near a wall builds none anew.
        # Ranges take a quarter of a second to build on two cores, and hold 20 MB at 640 px.
        self._sequences: dict[_SequenceKey, _PassSequence] = {}
        self._last: _PassSequence | None = None

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
        sequences = sum(sequence.memory_bytes for sequence in self._sequences.values())
        return self._passes.memory_bytes + sequences

    @property
    def face_counts(self) -> DrawCounts:
        """Cost of the last frame's faces."""
        return self._passes.faces.counts

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, Threshold] = NO_THRESHOLDS,
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            clock = StageClock(context.finish)
            if effects:
                exposed = self._expose(camera_state, effects, clock)
                thresholds = narrow_thresholds(
                    thresholds, effects, exposed.camera, lambda: (exposed.light, 1.0)
                )
                encoded = self._image_changer.encode(exposed, effects, thresholds)
                stage_ms = clock.stage_ms | encoded.stage_ms
                return RenderedImage(encoded.image, stage_ms, encoded.changes)
            # Without effects and shutter the pass after the faces encodes by itself: no float image
            # is written and read.
            sequence = self._find_sequence((True, False, camera_state.shutter is not None))
            self._run(sequence, camera_state, clock)
            image = self._passes.output.read()
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

    def prepare_plain(self) -> None:
        """Build the passes of frames without effects ahead of the first frame."""
        with self._device.context:
            self._find_sequence((True, False, False))

    def _expose(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...], clock: StageClock
    ) -> ExposedImage:
        """Read one exposure back, before its image effects."""
        has_ranges = any(effect.needs_range for effect in effects)
        sequence = self._find_sequence((False, has_ranges, camera_state.shutter is not None))
        self._run(sequence, camera_state, clock)
        light, range_m = sequence.read()
        clock.end_stage("readback")
        camera = self._passes.camera
        sources: tuple[LightSource, ...] = ()
        if range_m is not None and any(one.name == "VeilingGlare" for one in effects):
            # Loaded for the effect that reads sources: most cameras have none.
            from catoptra_server.effects.kernels.light_sources import find_light_sources

            sources = find_light_sources(self._passes.lights, camera, camera_state, range_m)
        return ExposedImage(
            light, camera, CaptureContext(camera_state.noise_seed, range_m, sources)
        )

    def _find_sequence(self, key: _SequenceKey) -> _PassSequence:
        """Sequence of a kind, built at the first call."""
        if key not in self._sequences:
            is_encoded, has_ranges, has_shutter = key
            self._sequences[key] = (
                self._passes.make_output(has_shutter=has_shutter)
                if is_encoded
                else self._passes.make_linear(has_ranges=has_ranges, has_shutter=has_shutter)
            )
        return self._sequences[key]

    def _run(self, sequence: _PassSequence, camera_state: CameraState, clock: StageClock) -> None:
        """Draw all passes of a sequence, timing each."""
        self._last = sequence
        for render_pass in sequence.passes:
            render_pass.draw(camera_state)
            clock.end_stage(render_pass.name)

    def close(self) -> None:
        """Free the view's resources on the device."""
        with self._device.context:
            for sequence in self._sequences.values():
                sequence.close()
            self._passes.close()


@dataclass(frozen=True, slots=True, eq=False)
class _PassSequence:
    """The passes from the faces to an image; the faces are freed with their view."""

    passes: tuple[Pass, ...]
    """Passes in order of rendering."""
    light: LinearImageTarget | None = None
    """Linear light before all image effects; None where the pass behind the faces encodes."""
    ranges: RangePass | None = None
    """Ranges of the pixels, None where no effect uses them."""

    def read(self) -> tuple[LinearImage, npt.NDArray[np.float32] | None]:
        """Read back (h, w, 3) light and (h, w) ranges, metres."""
        assert self.light is not None, "an exposed sequence has an image to read"
        return self.light.read(), self.ranges.read() if self.ranges else None

    @property
    def memory_bytes(self) -> int:
        """Size of the images of all passes, without the faces."""
        passes = (one for one in self.passes if not isinstance(one, FacePass))
        light = self.light.memory_bytes if self.light else 0
        return sum(one.memory_bytes for one in passes) + light

    def close(self) -> None:
        """Free the passes, and the images between them."""
        for render_pass in reversed(self.passes):
            if not isinstance(render_pass, FacePass):
                render_pass.close()
        if self.light is not None:
            self.light.close()


@dataclass(frozen=True, slots=True, eq=False)
class ViewPasses:
    """Builds the sequences of passes of one view, and owns the images that all of them use."""

    context: moderngl.Context
    """OpenGL context."""
    programs: ShaderPrograms
    """Shader programs of the context."""
    camera: OmniCamera | PerspectiveCamera
    """Camera model of the image."""
    faces: FacePass[Atlas] | FacePass[LensProjection]
    """First pass of every sequence."""
    output: OutputImage
    """Finished image."""
    make_image_pass: Callable[[moderngl.Framebuffer, Definitions], Pass]
    """Builds the pass from the faces to the image in a target, encoded or linear."""
    make_range_pass: Callable[[], RangePass]
    """Builds the pass that measures the range of each pixel."""
    lights: tuple[Light, ...]
    """Lights of the world, which may be in view."""
    lookup_map: moderngl.Texture | None = None
    """Atlas coordinates of the samples of a mirror's image; None for a lens."""

    @property
    def memory_bytes(self) -> int:
        """Size of faces, lookup map and output."""
        lookup_bytes = image_bytes(self.lookup_map) if self.lookup_map else 0
        return self.faces.memory_bytes + lookup_bytes + self.output.memory_bytes

    def make_output(self, *, has_shutter: bool) -> _PassSequence:
        """Sequence to the finished image; linear light is written only for a long exposure."""
        if not has_shutter:
            return _PassSequence((self.faces, self.make_image_pass(self.output.target, ENCODED)))
        # Sharp images are added up in linear light, so the sum is encoded by a pass of its own.
        exposed = self.make_linear(has_ranges=False, has_shutter=True)
        assert exposed.light is not None
        encode = AveragePass(
            self.context, self.programs, exposed.light.texture, 1, self.output.target, name="encode"
        )
        return _PassSequence((*exposed.passes, encode), exposed.light)

    def make_linear(self, *, has_ranges: bool, has_shutter: bool) -> _PassSequence:
        """Sequence to linear light that is read back, with ranges or without."""
        ranges = self.make_range_pass() if has_ranges else None
        light = self._make_light()
        # Ranges belong to the pose in the middle of the exposure, as in trace: effects by depth use
        # one range a pixel, not one for each time sample.
        range_passes = () if ranges is None else (ranges,)
        if not has_shutter:
            sharp = (self.faces, self.make_image_pass(light.target, LINEAR))
            return _PassSequence((*sharp, *range_passes), light, ranges)
        # The accumulation reads one image while it adds to the other.
        image = self._make_light()
        accumulation = AccumulationPass(
            self.context,
            self.programs,
            self.camera,
            (self.faces, self.make_image_pass(image.target, LINEAR)),
            image,
            light.target,
        )
        return _PassSequence((accumulation, *range_passes), light, ranges)

    def _make_light(self) -> LinearImageTarget:
        return LinearImageTarget(self.context, self.camera.width_px, self.camera.height_px)

    def close(self) -> None:
        """Free faces, lookup map and output."""
        self.faces.close()
        if self.lookup_map is not None:
            self.lookup_map.release()
        self.output.close()


def make_identity_map(context: moderngl.Context, camera: PerspectiveCamera) -> moderngl.Texture:
    """Lookup map that gives each pixel the texel of its own place."""
    size = (camera.width_px, camera.height_px)
    coordinates = (pixel_sample_positions(camera)[:, :, 0] / size).astype(np.float32)
    texture = context.texture(size, 2, coordinates.tobytes(), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
