"""A traced image of a camera: encoded at once, or changed by effects first.

The effects are those of `effects/` themselves, in float32: NumPy releases the GIL for whole arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.renderer import NO_THRESHOLDS, LinearImage, RenderedImage
from catoptra_server.render.time_samples import sample_shutter
from catoptra_server.render.trace.ray_table import Float32s, RayTable
from catoptra_server.render.trace.srgb_encoding import encode_srgb
from catoptra_server.render.trace.trace_engine import TracedRays, TraceRequest, pixel_ranges


@dataclass(frozen=True, slots=True, eq=False)
class PixelRangeRays:
    """Rays through the pixel centres."""

    table: RayTable
    """One ray a pixel."""
    rays: TracedRays
    """The same rays, prepared by the engine."""

    def measure(self, camera_state: CameraState) -> Float32s:
        """(h, w) ranges of all pixels, metres; inf where no surface is hit."""
        return pixel_ranges(self.table, self.rays.find_hits(camera_state))


class TraceOmniView:
    """The rays of one camera; those for ranges are prepared at their first use."""

    def __init__(
        self, camera: RadialCamera, rays: TracedRays, prepare_ranges: Callable[[], PixelRangeRays]
    ) -> None:
        """Keep the prepared rays.

        Args:
            camera: Camera model, for the effects.
            rays: Rays of the image.
            prepare_ranges: Prepares the rays through the pixel centres.
        """
        self._camera = camera
        self._rays = rays
        self._prepare_ranges = prepare_ranges
        self._ranges: PixelRangeRays | None = None

    @property
    def memory_bytes(self) -> int:
        """Size of all arrays."""
        return self._rays.memory_bytes + (self._ranges.rays.memory_bytes if self._ranges else 0)

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects; each effect is a stage."""
        # The engine encodes a sharp frame without effects itself, without any float image: the
        # usual case, and the fastest.
        if not effects and camera_state.shutter is None:
            begin = time.perf_counter()
            frame = self._rays.render(camera_state, TraceRequest(thresholds=thresholds))
            return RenderedImage(frame.image, {"trace": _elapsed_ms(begin)}, frame.changes)
        light, stage_ms, changes = self._apply_effects(camera_state, effects, thresholds)
        begin = time.perf_counter()
        rgb = encode_srgb(light)
        # Read-only, as the engine's frames: callers may keep both without a copy.
        rgb.setflags(write=False)
        return RenderedImage(rgb, stage_ms | {"encode": _elapsed_ms(begin)}, changes)

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""
        return self._apply_effects(camera_state, effects, NO_THRESHOLDS)[0]

    def _apply_effects(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
    ) -> tuple[LinearImage, dict[str, float], Mapping[str, float]]:
        """Linear image after all effects, milliseconds by stage, and changes by effect."""
        light, stage_ms, changes = self._render_exposure(camera_state, thresholds)
        context = self._make_capture_context(camera_state, effects, stage_ms)
        for effect in effects:
            begin = time.perf_counter()
            light = effect.apply(light, self._camera, context)
            stage_ms[effect.name] = _elapsed_ms(begin)
        return light, stage_ms, changes

    def _render_exposure(
        self, camera_state: CameraState, thresholds: Mapping[str, float]
    ) -> tuple[LinearImage, dict[str, float], Mapping[str, float]]:
        """Linear image at the sensor: of one instant, or the mean of several time samples."""
        begin = time.perf_counter()
        if camera_state.shutter is None:
            request = TraceRequest(is_linear=True, thresholds=thresholds)
            frame = self._rays.render(camera_state, request)
            return np.asarray(frame.image), {"trace": _elapsed_ms(begin)}, frame.changes
        light = np.zeros((self._camera.height_px, self._camera.width_px, 3), dtype=np.float32)
        for sharp_state, weights in sample_shutter(camera_state, self._camera.height_px):
            light += self._rays.render_linear(sharp_state) * weights[:, None, None]
        # One stage for all time samples, as in raster's accumulation pass.
        return light, {"accumulate": _elapsed_ms(begin)}, {}

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
            self._ranges = self._prepare_ranges()
        context = replace(context, range_m=self._ranges.measure(camera_state))
        stage_ms["ranges"] = _elapsed_ms(begin)
        return context

    def close(self) -> None:
        """Free the rays."""
        self._rays.close()
        if self._ranges is not None:
            self._ranges.rays.close()


def _elapsed_ms(begin_s: float) -> float:
    """Milliseconds since a reading of the performance counter."""
    return 1e3 * (time.perf_counter() - begin_s)
