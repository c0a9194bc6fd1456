"""Prepared cameras: passes in order, timed, and the readback of the image.

A frame with image effects is read back in linear light, and an image changer does the rest: on
llvmpipe the kernel's stages are several times as fast as the same formulas were as shaders, leave
out cells in which nobody sees an effect, and measure each effect's largest change, while the
readback takes less than a millisecond. No graphics processor has been measured.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping

import moderngl

from catoptra_protocol.optics.radial_camera import RadialCamera
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
from catoptra_server.world.camera_state import CameraState

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
