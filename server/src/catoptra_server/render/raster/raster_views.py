"""Cameras that are ready to be drawn: passes in order, timed, and the way back of the picture."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import moderngl

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.lens_projection import LensProjection
from catoptra_server.render.raster.effect_chain import EffectChain
from catoptra_server.render.raster.face_pass import DrawCounts, FacePass
from catoptra_server.render.raster.gl_device import GlDevice
from catoptra_server.render.raster.passes import OutputImage, Pass
from catoptra_server.render.renderer import LinearImage, RenderedImage
from catoptra_server.render.stage_clock import StageClock


class RasterView:
    """A camera's passes and its picture on the device."""

    def __init__(
        self,
        device: GlDevice,
        faces: FacePass[Atlas] | FacePass[LensProjection],
        passes: tuple[Pass, ...],
        output: OutputImage,
        thread: int,
    ) -> None:
        self._device = device
        self._faces = faces
        self._passes: tuple[Pass, ...] = (faces, *passes)
        self._output = output
        self._thread = thread

    @property
    def pass_names(self) -> tuple[str, ...]:
        """Return the names of the passes that every frame goes through."""
        return tuple(step.name for step in self._passes)

    @property
    def face_counts(self) -> DrawCounts:
        """Return what the faces of the last frame cost."""
        return self._faces.counts

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Return the picture of an exposure."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            clock = StageClock(context.finish)
            for step in self._passes:
                step.draw(camera_state)
                clock.end_stage(step.name)
            image = self._output.read()
            clock.end_stage("readback")
        return RenderedImage(image, clock.stage_ms)

    def close(self) -> None:
        """Free what the view holds on the device."""
        with self._device.context:
            for step in reversed(self._passes):
                step.close()
            self._output.close()


# Of pictures with effects so many are kept ready, lest a robot that stops and goes builds its
# passes anew each time: what it needs standing, slow, fast, and beside a wall. A list that asks
# what pixels see takes a quarter of a second to build on two cores, and holds 20 MB at 640 px.
_MAX_SEQUENCES = 4

# What a picture's passes are made for: its effects, and whether its exposure lasts.
SequenceKey = tuple[tuple[ImageEffect, ...], bool]
# Makes the passes of a picture: what is built is returned, and closed with the picture.
MakeLinearSequence = Callable[[tuple[ImageEffect, ...], bool], "PassSequence"]


@dataclass(frozen=True, slots=True, eq=False)
class PassSequence:
    """The passes from the faces to the finished picture; chain: None where light is not linear.

    The faces are their view's, and freed with it.
    """

    passes: tuple[Pass, ...]
    effect_chain: EffectChain | None = None

    def close(self) -> None:
        """Free the passes, and what is between them."""
        for step in reversed(self.passes):
            if not isinstance(step, FacePass):
                step.close()
        if self.effect_chain is not None:
            self.effect_chain.close()


class RasterOmniView:
    """A mirror camera: its faces, where samples look in them, and a picture a list of effects.

    plain: makes what needs no linear light; linear: what effects change. Neither is built before it
    is asked for; places are freed with the view.
    """

    def __init__(
        self,
        device: GlDevice,
        faces: FacePass[Atlas],
        lookup_map: moderngl.Texture,
        output: OutputImage,
        *,
        make_plain: Callable[[], PassSequence],
        make_linear: MakeLinearSequence,
        thread: int,
    ) -> None:
        self._device = device
        self._faces = faces
        self._lookup_map = lookup_map
        self._output = output
        self._make_plain = make_plain
        self._make_linear = make_linear
        self._thread = thread
        self._plain_passes: PassSequence | None = None
        self._linear_passes: dict[SequenceKey, PassSequence] = {}  # the last drawn at the end
        self._last: PassSequence | None = None

    @property
    def pass_names(self) -> tuple[str, ...]:
        """Return the names of the passes that the last frame went through."""
        return tuple(step.name for step in self.active_passes)

    @property
    def active_passes(self) -> tuple[Pass, ...]:
        """Return the passes themselves."""
        return self._last.passes if self._last else ()

    @property
    def num_sequences(self) -> int:
        """Return how many pictures are kept ready."""
        return len(self._linear_passes) + (self._plain_passes is not None)

    @property
    def face_counts(self) -> DrawCounts:
        """Return what the faces of the last frame cost."""
        return self._faces.counts

    def render(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> RenderedImage:
        """Return the picture of an exposure as effects change it."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            lasts = camera_state.shutter is not None
            picture = (
                self._linear_sequence(effects, lasts)
                if effects or lasts
                else self._plain_sequence()
            )
            clock = StageClock(context.finish)
            self._run(picture, camera_state, clock)
            image = self._output.read()
            clock.end_stage("readback")
        return RenderedImage(image, clock.stage_ms)

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Return the picture of an exposure behind all effects, before it is encoded."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            picture = self._linear_sequence(effects, camera_state.shutter is not None)
            self._run(picture, camera_state, StageClock(context.finish))
            assert picture.effect_chain is not None, "a linear picture has a chain"
            return picture.effect_chain.read()

    def _run(self, image: PassSequence, camera_state: CameraState, clock: StageClock) -> None:
        self._last = image
        for step in image.passes:
            step.draw(camera_state)
            clock.end_stage(step.name)

    def _plain_sequence(self) -> PassSequence:
        if self._plain_passes is None:
            self._plain_passes = self._make_plain()
        return self._plain_passes

    def _linear_sequence(self, effects: tuple[ImageEffect, ...], has_shutter: bool) -> PassSequence:
        wanted = (effects, has_shutter)
        picture = self._linear_passes.pop(wanted, None) or self._make_linear(effects, has_shutter)
        while len(self._linear_passes) >= _MAX_SEQUENCES:
            self._linear_passes.pop(next(iter(self._linear_passes))).close()
        self._linear_passes[wanted] = picture
        return picture

    def close(self) -> None:
        """Free what the view holds on the device."""
        with self._device.context:
            for picture in (self._plain_passes, *self._linear_passes.values()):
                if picture is not None:
                    picture.close()
            self._faces.close()
            self._lookup_map.release()
            self._output.close()
