"""Auto-exposure: the mean of the whole omnidirectional picture is brought to a target.

gain = clip(target / mean, least, most), the mean of the luminance (Rec. 709) of all pixels that see
the mirror, in linear light: one value for all faces, so no face is brighter than its neighbour. It
is the end that a control loop settles at, not the loop: a frame depends on no frame before it, so
that the same exposure gives the same bytes for whoever asks. Domain: a black picture takes `most`.
The usual target is the 18 % of a photographer's grey card. Criterion: the change of the grey that
changes most over all gains that the scene's brightest light leaves possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_gain
from catoptra_server.effects.scene_summary import SceneSummary

LUMINANCE_WEIGHTS = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True, slots=True)
class AutoExposure:
    """target: mean light wanted. least, most: the gains that shutter and amplifier allow."""

    target_luminance: float
    min_gain: float
    max_gain: float

    name: ClassVar[str] = "AutoExposure"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def gain(self, mean_luminance: float) -> float:
        """Return by how much a picture of this mean light is multiplied."""
        wished = self.target_luminance / mean_luminance if mean_luminance > 0.0 else self.max_gain
        return min(max(wished, self.min_gain), self.max_gain)

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the change of the grey that changes most, by the least or the most gain."""
        gains = (self.gain(summary.max_radiance), self.max_gain)
        value = max(max_change_by_gain(gain, summary.max_radiance) for gain in gains)
        return EffectBound(value, f"gains from {gains[0]:.3g} to {gains[1]:.3g} are possible")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of what is multiplied by the most."""
        return replace(summary, max_radiance=self.max_gain * summary.max_radiance)

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the multiplied picture."""
        return image * image.dtype.type(self.gain(mean_luminance(image, camera)))

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the gain."""
        return {"gain": float32_array(self.gain(measure_mean_luminance()))}


def mean_luminance(image: npt.NDArray[Real], camera: OmniCamera) -> float:
    """Return the mean luminance of the pixels that see the mirror."""
    colours = image.sum(axis=(0, 1), dtype=np.float64)
    return float(colours @ LUMINANCE_WEIGHTS) / max(count_mirror_pixels(camera), 1)


@lru_cache(maxsize=16)
def count_mirror_pixels(camera: OmniCamera) -> int:
    """Return how many pixels see the mirror in their middle; all others are black."""
    return int(direction_from_pixel(camera, pixel_sample_positions(camera))[1].sum())


EFFECT_TYPE = EffectType(
    "AutoExposure",
    AutoExposure,
    (
        EffectParameter("AutoExposureTarget", "target_luminance", 0.18, 1e-4, 1.0),
        EffectParameter("AutoExposureMinGain", "min_gain", 0.1, 1e-4, 1.0),
        EffectParameter("AutoExposureMaxGain", "max_gain", 10.0, 1.0, 1e4),
    ),
)
