"""A traced image of a camera: encoded at once, or changed by effects first.

The effects are applied by the engine's image changer: native stages, or the formulas of `effects/`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.image_changer import ExposedImage, ImageChanger
from catoptra_server.render.renderer import NO_THRESHOLDS, LinearImage, RenderedImage
from catoptra_server.render.trace.label_tables import LabelRequest
from catoptra_server.render.trace.trace_engine import (
    PixelLabels,
    TracedFrame,
    TracedRays,
    TraceRequest,
)
from catoptra_server.world.camera_state import CameraState


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
        return self.render_with_labels(camera_state, effects, thresholds, None)[0]

    def render_with_labels(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
        labels: LabelRequest | None,
    ) -> tuple[RenderedImage, PixelLabels | None]:
        """Render one exposure, and find labels along its rays where the engine can."""
        # The engine encodes a frame without image effects itself, without any float image: the
        # usual case, and the fastest.
        if not effects:
            request = TraceRequest(thresholds=thresholds, labels=labels)
            frame, stage_ms = self._trace(camera_state, request)
            assert frame.image.dtype == np.uint8
            return RenderedImage(frame.image, stage_ms, frame.changes), frame.labels
        frame, stage_ms = self._expose(camera_state, effects, thresholds, labels)
        exposed = self._expose_image(camera_state, frame)
        encoded = self._image_changer.encode(exposed, effects, thresholds)
        changes = {**frame.changes, **encoded.changes}
        return RenderedImage(encoded.image, stage_ms | encoded.stage_ms, changes), frame.labels

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""
        frame, _ = self._expose(camera_state, effects, NO_THRESHOLDS, None)
        exposed = self._expose_image(camera_state, frame)
        return self._image_changer.change(exposed, effects, NO_THRESHOLDS).image

    def _expose(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
        labels: LabelRequest | None,
    ) -> tuple[TracedFrame, dict[str, float]]:
        """Frame of linear light with all that the effects need, and milliseconds by stage."""
        has_ranges = any(effect.needs_range for effect in effects)
        request = TraceRequest(
            is_linear=True, has_ranges=has_ranges, thresholds=thresholds, labels=labels
        )
        return self._trace(camera_state, request)

    def _expose_image(self, camera_state: CameraState, frame: TracedFrame) -> ExposedImage:
        """Linear image at the sensor."""
        context = CaptureContext(camera_state.noise_seed, range_m=frame.range_m)
        return ExposedImage(frame.image, self._camera, context)

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
