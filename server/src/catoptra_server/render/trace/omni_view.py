"""A mirror camera's traced picture: finished greys, or linear light that effects change first.

Each with or without shadows.

The effects are those of `effects/` themselves, in float32: NumPy releases the GIL for whole arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property
from typing import Protocol, cast

import numpy as np

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import Effect
from catoptra_server.render.instants import instants
from catoptra_server.render.renderer import Exposure, Image, LinearImage, RenderedImage
from catoptra_server.render.trace.packed_light import Float32s, encoded_levels
from catoptra_server.render.trace.ray_view import Drawn


class Source(Protocol):
    """Prepared rays whose light is kept on one scale."""

    def picture(self, exposure: Exposure) -> Drawn:
        """Return a picture as its colours are stored, and milliseconds by stage."""


class TraceOmniView:
    """Sources of one camera, and what each pixel sees; none exists before it is asked for.

    greys, linear: make a source with or without shadows.
    """

    def __init__(
        self,
        camera: OmniCamera,
        *,
        greys: Callable[[bool], Source],
        linear: Callable[[bool], Source],
        ranges: Callable[[], Callable[[Exposure], Float32s]],
    ) -> None:
        self._camera = camera
        self._greys = cache(greys)
        self._linear = cache(linear)
        self._make_ranges = ranges

    @cached_property
    def _ranges(self) -> Callable[[Exposure], Float32s]:
        return self._make_ranges()

    def draw(self, exposure: Exposure, effects: tuple[Effect, ...] = ()) -> RenderedImage:
        """Return the picture of an exposure as effects change it; each is a stage of its own."""
        if not effects and exposure.shutter is None:
            rgb, stage_ms = self._greys(exposure.has_shadows).picture(exposure)
            return RenderedImage(cast(Image, rgb), stage_ms)
        light, stage_ms = self._developed(exposure, effects)
        begin = time.perf_counter()
        rgb = encoded_levels(light)
        rgb.setflags(write=False)
        return RenderedImage(rgb, stage_ms | {"encode": 1e3 * (time.perf_counter() - begin)})

    def draw_linear(self, exposure: Exposure, effects: tuple[Effect, ...] = ()) -> LinearImage:
        """Return the picture of an exposure behind all effects, before it is encoded."""
        return self._developed(exposure, effects)[0]

    def _developed(
        self, exposure: Exposure, effects: tuple[Effect, ...]
    ) -> tuple[LinearImage, dict[str, float]]:
        light, stage_ms = self._exposed(exposure)
        capture = self._captured(exposure, effects, stage_ms)
        for effect in effects:
            begin = time.perf_counter()
            light = effect.apply(light, self._camera, capture)
            stage_ms[effect.name] = 1e3 * (time.perf_counter() - begin)
        return light, stage_ms

    def _exposed(self, exposure: Exposure) -> tuple[LinearImage, dict[str, float]]:
        """Return the light that reaches the sensor: of one instant, or the mean of several."""
        source = self._linear(exposure.has_shadows)
        if exposure.shutter is None:
            drawn, stage_ms = source.picture(exposure)
            return cast(LinearImage, drawn), stage_ms
        begin = time.perf_counter()
        shape = (self._camera.height_px, self._camera.width_px, 3)
        light: LinearImage = np.zeros(shape, dtype=np.float32)
        for instant, weights in instants(exposure, self._camera.height_px):
            light += cast(LinearImage, source.picture(instant)[0]) * weights[:, None, None]
        return light, {"instants": 1e3 * (time.perf_counter() - begin)}

    def _captured(
        self, exposure: Exposure, effects: tuple[Effect, ...], stage_ms: dict[str, float]
    ) -> Capture:
        """Return what the effects may know; their ranges are a stage where one of them uses it."""
        capture = Capture(exposure.key)
        if not any(effect.uses_range for effect in effects):
            return capture
        begin = time.perf_counter()
        capture = replace(capture, range_m=self._ranges(exposure))
        stage_ms["ranges"] = 1e3 * (time.perf_counter() - begin)
        return capture

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""
