"""A traced image of an omnidirectional camera: encoded at once, or changed by effects first.

The effects are those of `effects/` themselves, in float32: NumPy releases the GIL for whole arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
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
    """Prepared rays whose radiance is stored on one scale."""

    @property
    def memory_bytes(self) -> int:
        """Size of the source's own tables."""

    def render_colours(self, camera_state: CameraState) -> RenderedColours:
        """Render an exposure into the colours of the scale; also milliseconds by stage."""


class PixelRangeSource(Protocol):
    """Prepared rays through the pixel centres."""

    memory_bytes: int
    """Size of the rays."""

    def measure(self, camera_state: CameraState) -> Float32s:
        """(h, w) ranges of all pixels, metres."""


# Builds a source of colours, with or without shadows.
SourceFactory = Callable[[bool], ColourSource]


class TraceOmniView:
    """Sources of colours and ranges of one camera, each built at its first use."""

    def __init__(
        self,
        camera: OmniCamera,
        *,
        make_encoded_source: SourceFactory,
        make_linear_source: SourceFactory,
        make_ranges: Callable[[], PixelRangeSource],
        ray_bytes: int,
    ) -> None:
        """Keep the factories.

        Args:
            camera: Camera model, for the effects.
            make_encoded_source: Builds a source of sRGB colours, with or without shadows.
            make_linear_source: Builds a source of linear light, with or without shadows.
            make_ranges: Builds the source of the ranges of all pixels.
            ray_bytes: Size of the rays that the sources of colours share.
        """
        self._camera = camera
        self._make_encoded_source = make_encoded_source
        self._make_linear_source = make_linear_source
        self._make_ranges = make_ranges
        self._ray_bytes = ray_bytes
        # At most four, by scale and shadows.
        self._sources: dict[tuple[SourceFactory, bool], ColourSource] = {}
        self._ranges: PixelRangeSource | None = None

    @property
    def memory_bytes(self) -> int:
        """Size of all arrays."""
        sources = sum(source.memory_bytes for source in self._sources.values())
        return self._ray_bytes + sources + (self._ranges.memory_bytes if self._ranges else 0)

    def _find_source(self, make: SourceFactory, has_shadows: bool) -> ColourSource:
        """Source of a scale, with or without shadows, built at its first use."""
        key = (make, has_shadows)
        if key not in self._sources:
            self._sources[key] = make(has_shadows)
        return self._sources[key]

    def render(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects; each effect is a stage."""
        # Samples of a sharp frame without effects are summed and encoded by one table, without any
        # float image: the usual case, and the fastest.
        if not effects and camera_state.shutter is None:
            source = self._find_source(self._make_encoded_source, camera_state.has_shadows)
            rgb, stage_ms = source.render_colours(camera_state)
            return RenderedImage(cast(Image, rgb), stage_ms)
        light, stage_ms = self._apply_effects(camera_state, effects)
        begin = time.perf_counter()
        rgb = encode_srgb(light)
        # Read-only, as frames from the table: callers may keep both without a copy.
        rgb.setflags(write=False)
        return RenderedImage(rgb, stage_ms | {"encode": 1e3 * (time.perf_counter() - begin)})

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""
        return self._apply_effects(camera_state, effects)[0]

    def _apply_effects(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...]
    ) -> tuple[LinearImage, dict[str, float]]:
        """Linear image after all effects, and milliseconds by stage."""
        light, stage_ms = self._render_exposure(camera_state)
        context = self._make_capture_context(camera_state, effects, stage_ms)
        for effect in effects:
            begin = time.perf_counter()
            light = effect.apply(light, self._camera, context)
            stage_ms[effect.name] = 1e3 * (time.perf_counter() - begin)
        return light, stage_ms

    def _render_exposure(self, camera_state: CameraState) -> tuple[LinearImage, dict[str, float]]:
        """Linear image at the sensor: of one instant, or the mean of several time samples."""
        source = self._find_source(self._make_linear_source, camera_state.has_shadows)
        if camera_state.shutter is None:
            image, stage_ms = source.render_colours(camera_state)
            return cast(LinearImage, image), stage_ms
        begin = time.perf_counter()
        shape = (self._camera.height_px, self._camera.width_px, 3)
        light: LinearImage = np.zeros(shape, dtype=np.float32)
        for sharp_state, weights in sample_shutter(camera_state, self._camera.height_px):
            light += (
                cast(LinearImage, source.render_colours(sharp_state)[0]) * weights[:, None, None]
            )
        # One stage for all time samples, as in raster's accumulation pass.
        return light, {"accumulate": 1e3 * (time.perf_counter() - begin)}

    def _make_capture_context(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        stage_ms: dict[str, float],
    ) -> CaptureContext:
        """Inputs of effects beside the image; ranges are a stage where some effect uses them."""
        context = CaptureContext(camera_state.noise_seed)
        if not any(effect.needs_range for effect in effects):
            return context
        begin = time.perf_counter()
        if self._ranges is None:
            self._ranges = self._make_ranges()
        context = replace(context, range_m=self._ranges.measure(camera_state))
        stage_ms["ranges"] = 1e3 * (time.perf_counter() - begin)
        return context

    def close(self) -> None:
        """Do nothing: all resources belong to the renderer."""
