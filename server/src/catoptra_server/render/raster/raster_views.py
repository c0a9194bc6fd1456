"""Prepared cameras: passes in order, timed, and the readback of the image."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import moderngl

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.lens_projection import LensProjection
from catoptra_server.render.raster.effect_chain import EffectChain
from catoptra_server.render.raster.face_pass import DrawCounts, FacePass
from catoptra_server.render.raster.gl_device import GlDevice
from catoptra_server.render.raster.passes import OutputImage, Pass, image_bytes
from catoptra_server.render.renderer import NO_THRESHOLDS, LinearImage, RenderedImage
from catoptra_server.render.stage_clock import StageClock

# Sequences with effects that stay ready, so that a robot that stops and goes does not rebuild its
# passes each time: standing, slow, fast, and beside a wall. A sequence that measures ranges takes a
# quarter of a second to build on two cores, and holds 20 MB at 640 px.
_MAX_SEQUENCES = 4

# Effects of a sequence, and whether the exposure has a shutter.
SequenceKey = tuple[tuple[ImageEffect, ...], bool]
# Builds the passes of a sequence; the resources are freed with the sequence.
MakeLinearSequence = Callable[[tuple[ImageEffect, ...], bool], "PassSequence"]


@dataclass(frozen=True, slots=True, eq=False)
class PassSequence:
    """The passes from the faces to the finished image; the faces are freed with their view."""

    passes: tuple[Pass, ...]
    """Passes in order of rendering."""
    effect_chain: EffectChain | None = None
    """Effects and encoding, None where the pass before encodes by itself."""

    @property
    def memory_bytes(self) -> int:
        """Size of the images of passes and effects, without the faces."""
        passes = (one for one in self.passes if not isinstance(one, FacePass))
        chain = self.effect_chain.memory_bytes if self.effect_chain else 0
        return sum(one.memory_bytes for one in passes) + chain

    def close(self) -> None:
        """Free the passes, and the images between them."""
        for render_pass in reversed(self.passes):
            if not isinstance(render_pass, FacePass):
                render_pass.close()
        if self.effect_chain is not None:
            self.effect_chain.close()


class RasterOmniView:
    """A camera: faces, a mirror's lookup map, and one sequence of passes per effect list."""

    def __init__(
        self,
        device: GlDevice,
        faces: FacePass[Atlas] | FacePass[LensProjection],
        lookup_map: moderngl.Texture | None,
        output: OutputImage,
        *,
        make_plain: Callable[[], PassSequence],
        make_linear: MakeLinearSequence,
        thread: int,
    ) -> None:
        """Take over faces, lookup map and output, which are freed with the view.

        Args:
            device: Device that renders.
            faces: Face pass of the camera.
            lookup_map: Atlas coordinates of the image's samples; None for a lens.
            output: Finished image.
            make_plain: Builds the sequence without linear light; called at its first use.
            make_linear: Builds the sequence of effects or of a long exposure; called at its first
                use.
            thread: Identifier of the only thread that may use the view.
        """
        self._device = device
        self._faces = faces
        self._lookup_map = lookup_map
        self._output = output
        self._make_plain = make_plain
        self._make_linear = make_linear
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
            has_shutter = camera_state.shutter is not None
            # Without effects and shutter the pass after the faces encodes by itself: no float image
            # is written and read.
            sequence = (
                self._linear_sequence(effects, has_shutter)
                if effects or has_shutter
                else self._plain_sequence()
            )
            clock = StageClock(context.finish)
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
            sequence = self._linear_sequence(effects, camera_state.shutter is not None)
            self._run(sequence, camera_state, StageClock(context.finish))
            assert sequence.effect_chain is not None, "a linear sequence has an effect chain"
            return sequence.effect_chain.read()

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
            self._plain_passes = self._make_plain()
        return self._plain_passes

    def _linear_sequence(self, effects: tuple[ImageEffect, ...], has_shutter: bool) -> PassSequence:
        """Sequence of a list of effects: least recently used sequences are freed."""
        key = (effects, has_shutter)
        # Dictionaries keep the order of insertion: taken out and put back, the sequence becomes
        # the last, and the first is the least recently used.
        sequence = self._linear_passes.pop(key, None) or self._make_linear(effects, has_shutter)
        while len(self._linear_passes) >= _MAX_SEQUENCES:
            self._linear_passes.pop(next(iter(self._linear_passes))).close()
        self._linear_passes[key] = sequence
        return sequence

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
