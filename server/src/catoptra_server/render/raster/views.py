"""Cameras that are ready to be drawn: passes in order, timed, and the way back of the picture."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import moderngl

from catoptra_server.effects.effect import Effect
from catoptra_server.render.raster.atlas import Atlas
from catoptra_server.render.raster.context import GlDevice
from catoptra_server.render.raster.effect_chain import EffectChain
from catoptra_server.render.raster.faces import DrawCounts, FacePass
from catoptra_server.render.raster.lens_cell import LensCell
from catoptra_server.render.raster.passes import Output, Pass
from catoptra_server.render.raster.timing import StageClock
from catoptra_server.render.renderer import Exposure, LinearImage, RenderedImage


class RasterView:
    """A camera's passes and its picture on the device."""

    def __init__(
        self,
        device: GlDevice,
        faces: FacePass[Atlas] | FacePass[LensCell],
        picture: tuple[Pass, ...],
        output: Output,
        thread: int,
    ) -> None:
        self._device = device
        self._faces = faces
        self._passes: tuple[Pass, ...] = (faces, *picture)
        self._output = output
        self._thread = thread

    @property
    def passes(self) -> tuple[str, ...]:
        """Return the names of the passes that every frame goes through."""
        return tuple(step.name for step in self._passes)

    @property
    def face_counts(self) -> DrawCounts:
        """Return what the faces of the last frame cost."""
        return self._faces.counts

    def draw(self, exposure: Exposure) -> RenderedImage:
        """Return the picture of an exposure."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            clock = StageClock(context.finish)
            for step in self._passes:
                step.draw(exposure)
                clock.mark(step.name)
            image = self._output.read()
            clock.mark("readback")
        return RenderedImage(image, clock.ms)

    def close(self) -> None:
        """Free what the view holds on the device."""
        with self._device.context:
            for step in reversed(self._passes):
                step.close()
            self._output.close()


# Of pictures with effects so many are kept ready, lest a robot that stops and goes builds its
# passes anew each time: what it needs standing, slow, fast, and beside a wall. A list that asks
# what pixels see takes a quarter of a second to build on two cores, and holds 20 MB at 640 px.
_KEPT = 4

# What a picture's passes are made for: its effects, and whether its exposure lasts.
Wanted = tuple[tuple[Effect, ...], bool]
# Makes the passes of a picture: what is built is returned, and closed with the picture.
MakePicture = Callable[[tuple[Effect, ...], bool], "Developed"]


@dataclass(frozen=True, slots=True, eq=False)
class Developed:
    """The passes from the faces to the finished picture; chain: None where light is not linear.

    The faces are their view's, and freed with it.
    """

    passes: tuple[Pass, ...]
    chain: EffectChain | None = None

    def close(self) -> None:
        """Free the passes, and what is between them."""
        for step in reversed(self.passes):
            if not isinstance(step, FacePass):
                step.close()
        if self.chain is not None:
            self.chain.close()


class RasterOmniView:
    """A mirror camera: its faces, where samples look in them, and a picture a list of effects.

    plain: makes what needs no linear light; linear: what effects change. Neither is built before it
    is asked for; places are freed with the view.
    """

    def __init__(
        self,
        device: GlDevice,
        faces: FacePass[Atlas],
        places: moderngl.Texture,
        output: Output,
        *,
        plain: Callable[[], Developed],
        linear: MakePicture,
        thread: int,
    ) -> None:
        self._device = device
        self._faces = faces
        self._places = places
        self._output = output
        self._make_plain = plain
        self._make_linear = linear
        self._thread = thread
        self._plain: Developed | None = None
        self._linear: dict[Wanted, Developed] = {}  # the last drawn at the end
        self._last: Developed | None = None

    @property
    def passes(self) -> tuple[str, ...]:
        """Return the names of the passes that the last frame went through."""
        return tuple(step.name for step in self.steps)

    @property
    def steps(self) -> tuple[Pass, ...]:
        """Return the passes themselves."""
        return self._last.passes if self._last else ()

    @property
    def pictures(self) -> int:
        """Return how many pictures are kept ready."""
        return len(self._linear) + (self._plain is not None)

    @property
    def face_counts(self) -> DrawCounts:
        """Return what the faces of the last frame cost."""
        return self._faces.counts

    def draw(self, exposure: Exposure, effects: tuple[Effect, ...] = ()) -> RenderedImage:
        """Return the picture of an exposure as effects change it."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            lasts = exposure.shutter is not None
            picture = self._with(effects, lasts) if effects or lasts else self._without()
            clock = StageClock(context.finish)
            self._run(picture, exposure, clock)
            image = self._output.read()
            clock.mark("readback")
        return RenderedImage(image, clock.ms)

    def draw_linear(self, exposure: Exposure, effects: tuple[Effect, ...] = ()) -> LinearImage:
        """Return the picture of an exposure behind all effects, before it is encoded."""
        assert threading.get_ident() == self._thread, "a view belongs to its renderer's thread"
        with self._device.context as context:
            picture = self._with(effects, exposure.shutter is not None)
            self._run(picture, exposure, StageClock(context.finish))
            assert picture.chain is not None, "a linear picture has a chain"
            return picture.chain.read()

    def _run(self, picture: Developed, exposure: Exposure, clock: StageClock) -> None:
        self._last = picture
        for step in picture.passes:
            step.draw(exposure)
            clock.mark(step.name)

    def _without(self) -> Developed:
        if self._plain is None:
            self._plain = self._make_plain()
        return self._plain

    def _with(self, effects: tuple[Effect, ...], lasts: bool) -> Developed:
        wanted = (effects, lasts)
        picture = self._linear.pop(wanted, None) or self._make_linear(effects, lasts)
        while len(self._linear) >= _KEPT:
            self._linear.pop(next(iter(self._linear))).close()
        self._linear[wanted] = picture
        return picture

    def close(self) -> None:
        """Free what the view holds on the device."""
        with self._device.context:
            for picture in (self._plain, *self._linear.values()):
                if picture is not None:
                    picture.close()
            self._faces.close()
            self._places.release()
            self._output.close()
