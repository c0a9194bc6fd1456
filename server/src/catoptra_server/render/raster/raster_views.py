"""Prepared cameras: passes in order, timed, and the readback of the image."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import moderngl

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.image_changer import ExposedImage, ImageChanger
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.lens_projection import LensProjection
from catoptra_server.render.raster.face_pass import DrawCounts, FacePass
from catoptra_server.render.raster.gl_device import GlDevice
from catoptra_server.render.raster.pass_sequence import PassSequence, SequenceFactory
from catoptra_server.render.raster.passes import OutputImage, Pass, image_bytes
from catoptra_server.render.renderer import NO_THRESHOLDS, LinearImage, RenderedImage
from catoptra_server.render.stage_clock import StageClock

# Sequences with effects that stay ready, so that a robot that stops and goes does not rebuild its
# passes each time: standing, slow, fast, and beside a wall. A sequence that measures ranges takes a
# quarter of a second to build on two cores, and holds 20 MB at 640 px.
_MAX_SEQUENCES = 4

# Effects that are passes, None for an exposure that is read back; whether there are ranges; whether
# the exposure has a shutter.
SequenceKey = tuple[tuple[ImageEffect, ...] | None, bool, bool]


class RasterOmniView:
    """A camera: faces, a mirror's lookup map, and one sequence of passes per effect list."""

    def __init__(
        self,
        device: GlDevice,
        faces: FacePass[Atlas] | FacePass[LensProjection],
        lookup_map: moderngl.Texture | None,
        output: OutputImage,
        *,
        camera: RadialCamera,
        sequences: SequenceFactory,
        image_changer: ImageChanger | None,
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
            image_changer: Applies image effects to exposures that are read back; None for passes.
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
        self._plain_passes: PassSequence | None = None
        self._linear_passes: dict[SequenceKey, PassSequence] = {}  # most recently used last
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
        sequences = (self._plain_passes, *self._linear_passes.values())
        return (
            self._faces.memory_bytes
            + (image_bytes(self._lookup_map) if self._lookup_map else 0)
            + self._output.memory_bytes
            + sum(sequence.memory_bytes for sequence in sequences if sequence)
        )

    @property
    def num_sequences(self) -> int:
        """Number of pass sequences that are ready."""
        return len(self._linear_passes) + (self._plain_passes is not None)

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
            if effects and self._image_changer is not None:
                exposed = self._expose(camera_state, effects, clock)
                encoded = self._image_changer.encode(exposed, effects, thresholds)
                stage_ms = clock.stage_ms | encoded.stage_ms
                return RenderedImage(encoded.image, stage_ms, encoded.changes)
            self._run(self._finishing_sequence(camera_state, effects), camera_state, clock)
            image = self._output.read()
            clock.end_stage("readback")
        return RenderedImage(image, clock.stage_ms)

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            clock = StageClock(context.finish)
            if effects and self._image_changer is not None:
                exposed = self._expose(camera_state, effects, clock)
                return self._image_changer.change(exposed, effects, NO_THRESHOLDS).image
            sequence = self._linear_sequence((effects, False, camera_state.shutter is not None))
            self._run(sequence, camera_state, clock)
            assert sequence.effect_chain is not None, "a linear sequence has an effect chain"
            return sequence.effect_chain.read()

    def _expose(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...], clock: StageClock
    ) -> ExposedImage:
        """Read one exposure back, before its image effects."""
        has_ranges = any(effect.needs_range for effect in effects)
        sequence = self._linear_sequence((None, has_ranges, camera_state.shutter is not None))
        self._run(sequence, camera_state, clock)
        assert sequence.exposure is not None, "an exposed sequence has an image to read"
        light, range_m = sequence.exposure.read()
        clock.end_stage("readback")
        context = CaptureContext(camera_state.noise_seed, range_m=range_m)
        return ExposedImage(light, self._camera, context)

    def _finishing_sequence(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...]
    ) -> PassSequence:
        """Sequence to the finished image, with effects as passes."""
        # Without effects and shutter the pass after the faces encodes by itself: no float image is
        # written and read.
        has_shutter = camera_state.shutter is not None
        if effects or has_shutter:
            return self._linear_sequence((effects, False, has_shutter))
        return self._plain_sequence()

    def _run(self, sequence: PassSequence, camera_state: CameraState, clock: StageClock) -> None:
        """Draw all passes of a sequence, timing each."""
        self._last = sequence
        for render_pass in sequence.passes:
            render_pass.draw(camera_state)
            clock.end_stage(render_pass.name)

    def prepare_plain(self) -> None:
        """Build the passes of frames without effects ahead of the first frame."""
        with self._device.context:
            self._plain_sequence()

    def _plain_sequence(self) -> PassSequence:
        """Sequence without linear light, built at the first call."""
        if self._plain_passes is None:
            self._plain_passes = self.sequences.make_plain()
        return self._plain_passes

    def _linear_sequence(self, key: SequenceKey) -> PassSequence:
        """Sequence with linear light: least recently used sequences are freed."""
        # Dictionaries keep the order of insertion: taken out and put back, the sequence becomes
        # the last, and the first is the least recently used.
        sequence = self._linear_passes.pop(key, None) or self._make_sequence(key)
        while len(self._linear_passes) >= _MAX_SEQUENCES:
            self._linear_passes.pop(next(iter(self._linear_passes))).close()
        self._linear_passes[key] = sequence
        return sequence

    def _make_sequence(self, key: SequenceKey) -> PassSequence:
        effects, has_ranges, has_shutter = key
        if effects is None:
            return self.sequences.make_exposure(has_ranges=has_ranges, has_shutter=has_shutter)
        return self.sequences.make_linear(effects, has_shutter)

    def close(self) -> None:
        """Free the view's resources on the device."""
        with self._device.context:
            for sequence in (self._plain_passes, *self._linear_passes.values()):
                if sequence is not None:
                    sequence.close()
            self._faces.close()
            if self._lookup_map is not None:
                self._lookup_map.release()
            self._output.close()
