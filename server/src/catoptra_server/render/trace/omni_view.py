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

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.renderer import Image, LinearImage, RenderedImage
from catoptra_server.render.time_samples import sample_shutter
from catoptra_server.render.trace.packed_light import Float32s, encode_srgb
from catoptra_server.render.trace.ray_view import RenderedColours


class ColourSource(Protocol):
    """Prepared rays whose light is kept on one scale."""

    def render_colours(self, camera_state: CameraState) -> RenderedColours:
        """Return a picture as its colours are stored, and milliseconds by stage."""


class TraceOmniView:
    """Sources of one camera, and what each pixel sees; none exists before it is asked for.

    greys, linear: make a source with or without shadows.
    """

    def __init__(
        self,
        camera: OmniCamera,
        *,
        make_encoded_source: Callable[[bool], ColourSource],
        make_linear_source: Callable[[bool], ColourSource],
        make_ranges: Callable[[], Callable[[CameraState], Float32s]],
    ) -> None:
        self._camera = camera
        self._encoded_source = cache(make_encoded_source)
        self._linear_source = cache(make_linear_source)
        self._make_ranges = make_ranges

    @cached_property
    def _ranges(self) -> Callable[[CameraState], Float32s]:
        return self._make_ranges()

    def render(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> RenderedImage:
        """Return the picture of an exposure as effects change it; each is a stage of its own."""
        if not effects and camera_state.shutter is None:
            rgb, stage_ms = self._encoded_source(camera_state.has_shadows).render_colours(
                camera_state
            )
            return RenderedImage(cast(Image, rgb), stage_ms)
        light, stage_ms = self._apply_effects(camera_state, effects)
        begin = time.perf_counter()
        rgb = encode_srgb(light)
        rgb.setflags(write=False)
        return RenderedImage(rgb, stage_ms | {"encode": 1e3 * (time.perf_counter() - begin)})

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Return the picture of an exposure behind all effects, before it is encoded."""
        return self._apply_effects(camera_state, effects)[0]

    def _apply_effects(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...]
    ) -> tuple[LinearImage, dict[str, float]]:
        light, stage_ms = self._render_exposure(camera_state)
        capture = self._make_capture_context(camera_state, effects, stage_ms)
        for effect in effects:
            begin = time.perf_counter()
            light = effect.apply(light, self._camera, capture)
            stage_ms[effect.name] = 1e3 * (time.perf_counter() - begin)
        return light, stage_ms

    def _render_exposure(self, camera_state: CameraState) -> tuple[LinearImage, dict[str, float]]:
        """Return the light that reaches the sensor: of one instant, or the mean of several."""
        source = self._linear_source(camera_state.has_shadows)
        if camera_state.shutter is None:
            drawn, stage_ms = source.render_colours(camera_state)
            return cast(LinearImage, drawn), stage_ms
        begin = time.perf_counter()
        shape = (self._camera.height_px, self._camera.width_px, 3)
        light: LinearImage = np.zeros(shape, dtype=np.float32)
        for instant, weights in sample_shutter(camera_state, self._camera.height_px):
            light += cast(LinearImage, source.render_colours(instant)[0]) * weights[:, None, None]
        return light, {"accumulate": 1e3 * (time.perf_counter() - begin)}

    def _make_capture_context(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        stage_ms: dict[str, float],
    ) -> CaptureContext:
        """Return what the effects may know; their ranges are a stage where one of them uses it."""
        capture = CaptureContext(camera_state.noise_seed)
        if not any(effect.needs_range for effect in effects):
            return capture
        begin = time.perf_counter()
        capture = replace(capture, range_m=self._ranges(camera_state))
        stage_ms["ranges"] = 1e3 * (time.perf_counter() - begin)
        return capture

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""
