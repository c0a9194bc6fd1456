"""Cameras that are ready to be drawn: passes in order, timed, and the way back of the picture."""

from __future__ import annotations

import threading

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


class RasterEffectView:
    """A view with effects between its mirror and its greys."""

    def __init__(self, device: GlDevice, view: RasterView, chain: EffectChain) -> None:
        self._device = device
        self._view = view
        self._chain = chain

    @property
    def passes(self) -> tuple[str, ...]:
        """Return the names of the passes that every frame goes through."""
        return self._view.passes

    def draw(self, exposure: Exposure) -> RenderedImage:
        """Return the picture of an exposure."""
        return self._view.draw(exposure)

    def draw_linear(self, exposure: Exposure) -> LinearImage:
        """Return the picture of an exposure behind all effects, before it is encoded."""
        self._view.draw(exposure)
        with self._device.context:
            return self._chain.read()

    def close(self) -> None:
        """Free what the view holds on the device."""
        self._view.close()
        with self._device.context:
            self._chain.close()
