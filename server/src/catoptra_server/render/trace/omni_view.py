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

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import Capture, Geometry
from catoptra_server.effects.effect import Effect
from catoptra_server.render.renderer import Exposure, Image, LinearImage, RenderedImage
from catoptra_server.render.staging import captured
from catoptra_server.render.trace.packed_light import encoded_levels
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
        geometry: Callable[[], Callable[[Exposure], Geometry]],
    ) -> None:
        self._camera = camera
        self._greys = cache(greys)
        self._linear = cache(linear)
        self._make_geometry = geometry

    @cached_property
    def _geometry(self) -> Callable[[Exposure], Geometry]:
        return self._make_geometry()

    def draw(self, exposure: Exposure, effects: tuple[Effect, ...] = ()) -> RenderedImage:
        """Return the picture of an exposure as effects change it; each is a stage of its own."""
        if not effects:
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
        drawn, stage_ms = self._linear(exposure.has_shadows).picture(exposure)
        light = cast(LinearImage, drawn)
        capture = self._captured(exposure, effects, stage_ms)
        for effect in effects:
            begin = time.perf_counter()
            light = effect.apply(light, self._camera, capture)
            stage_ms[effect.name] = 1e3 * (time.perf_counter() - begin)
        return light, stage_ms

    def _captured(
        self, exposure: Exposure, effects: tuple[Effect, ...], stage_ms: dict[str, float]
    ) -> Capture:
        """Return what the effects may know; geometry is a stage where one of them uses it."""
        capture = captured(exposure)
        if not any(effect.uses_geometry for effect in effects):
            return capture
        begin = time.perf_counter()
        capture = replace(capture, geometry=self._geometry(exposure))
        stage_ms["geometry"] = 1e3 * (time.perf_counter() - begin)
        return capture

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""
