"""A traced image of a camera: encoded at once, or changed by effects first.

The effects are applied by the engine's image changer: native stages, or the formulas of `effects/`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.image_changer import ExposedImage, ImageChanger
from catoptra_server.render.renderer import NO_THRESHOLDS, LinearImage, RenderedImage
from catoptra_server.render.trace.trace_engine import TracedFrame, TracedRays, TraceRequest


class TraceOmniView:
    """The rays of one camera."""

    def __init__(self, camera: RadialCamera, rays: TracedRays, image_changer: ImageChanger) -> None:
        """Keep the prepared rays.

        Args:
            camera: Camera model, for the effects.
            rays: Rays of the image.
            image_changer: Applies image effects.
        """
        self._camera = camera
        self._rays = rays
        self._image_changer = image_changer

    @property
    def memory_bytes(self) -> int:
        """Size of all arrays."""
        return self._rays.memory_bytes

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects; each effect is a stage."""
        # The engine encodes a frame without image effects itself, without any float image: the
        # usual case, and the fastest.
        if not effects:
            frame, stage_ms = self._trace(camera_state, TraceRequest(thresholds=thresholds))
            assert frame.image.dtype == np.uint8
            return RenderedImage(frame.image, stage_ms, frame.changes)
        exposed, stage_ms, changes = self._expose(camera_state, effects, thresholds)
        encoded = self._image_changer.encode(exposed, effects, thresholds)
        all_changes = {**changes, **encoded.changes}
        return RenderedImage(encoded.image, stage_ms | encoded.stage_ms, all_changes)

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""
        exposed, _, _ = self._expose(camera_state, effects, NO_THRESHOLDS)
        return self._image_changer.change(exposed, effects, NO_THRESHOLDS).image

    def _expose(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
    ) -> tuple[ExposedImage, dict[str, float], Mapping[str, float]]:
        """Linear image at the sensor, milliseconds by stage, and changes by scene effect."""
        has_ranges = any(effect.needs_range for effect in effects)
        request = TraceRequest(is_linear=True, has_ranges=has_ranges, thresholds=thresholds)
        frame, stage_ms = self._trace(camera_state, request)
        context = CaptureContext(camera_state.noise_seed, range_m=frame.range_m)
        return ExposedImage(frame.image, self._camera, context), stage_ms, frame.changes

    def _trace(
        self, camera_state: CameraState, request: TraceRequest
    ) -> tuple[TracedFrame, dict[str, float]]:
        """A frame of the engine, and its milliseconds: its own stages apart from the rest."""
        begin = time.perf_counter()
        frame = self._rays.render(camera_state, request)
        rest_ms = _elapsed_ms(begin) - sum(frame.stage_ms.values())
        return frame, {"trace": rest_ms, **frame.stage_ms}

    def close(self) -> None:
        """Free the rays."""
        self._rays.close()


def _elapsed_ms(begin_s: float) -> float:
    """Milliseconds since a reading of the performance counter."""
    return 1e3 * (time.perf_counter() - begin_s)
