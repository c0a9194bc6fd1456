"""A traced picture in linear light, then its effects one after the other, then its greys.

The effects are those of `effects/` themselves, in float32: NumPy releases the GIL for whole arrays.
"""

from __future__ import annotations

import time
from typing import Protocol, cast

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.effect import Effect
from catoptra_server.render.renderer import Exposure, LinearImage, RenderedImage
from catoptra_server.render.trace.packed_light import encoded_levels
from catoptra_server.render.trace.ray_view import Drawn


class LinearSource(Protocol):
    """A view prepared with a linear scale."""

    def picture(self, exposure: Exposure) -> Drawn:
        """Return a float32 picture, and milliseconds by stage."""

    def close(self) -> None:
        """Free what the view holds."""


class TraceEffectView:
    """A linear view and the effects behind it; each is a stage of its own in the timings."""

    def __init__(
        self, source: LinearSource, effects: tuple[Effect, ...], camera: OmniCamera
    ) -> None:
        self._source = source
        self._effects = effects
        self._camera = camera

    def draw(self, exposure: Exposure) -> RenderedImage:
        """Return the picture of an exposure."""
        light, stage_ms = self._developed(exposure)
        begin = time.perf_counter()
        rgb = encoded_levels(light)
        rgb.setflags(write=False)
        return RenderedImage(rgb, stage_ms | {"encode": 1e3 * (time.perf_counter() - begin)})

    def draw_linear(self, exposure: Exposure) -> LinearImage:
        """Return the picture of an exposure behind all effects, before it is encoded."""
        return self._developed(exposure)[0]

    def _developed(self, exposure: Exposure) -> tuple[LinearImage, dict[str, float]]:
        drawn, stage_ms = self._source.picture(exposure)
        light = cast(LinearImage, drawn)
        for effect in self._effects:
            begin = time.perf_counter()
            light = effect.apply(light, self._camera, exposure.key)
            stage_ms[effect.name] = 1e3 * (time.perf_counter() - begin)
        return light, stage_ms

    def close(self) -> None:
        """Free what the linear view holds."""
        self._source.close()
