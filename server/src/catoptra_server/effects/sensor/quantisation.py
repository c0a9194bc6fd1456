"""Quantisation: the converter knows 2^bits - 1 steps of equal light, and none above white.

L' = min(floor((2^b - 1) L + 1/2) / (2^b - 1), 1). Negative codes are kept, as a converter keeps
them by a black level that is subtracted later. Source: EMVA Standard 1288, the linear camera model:
a variance of 1/12 of a squared step. Domain: any light, 1 to 16 bits. Criterion: half a step in the
dark, where the sRGB curve is steepest: 12 bits stay below half a grey level, 8 bits do not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
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
from catoptra_server.effects.kernels.grey_levels import max_change_by_offset
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class Quantisation:
    """adc_bits: the converter's, a whole number."""

    adc_bits: float

    name: ClassVar[str] = "Quantisation"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    @property
    def max_code(self) -> float:
        """Return the largest code."""
        return float(2 ** int(self.adc_bits) - 1)

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what half a step is in the dark."""
        value = max_change_by_offset(
            lambda light: np.full_like(light, 0.5 / self.max_code), summary.max_radiance
        )
        return EffectBound(value, f"a converter of {int(self.adc_bits)} bits")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of what was rounded up."""
        return replace(summary, max_radiance=min(summary.max_radiance + 0.5 / self.max_code, 1.0))

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the rounded picture."""
        kind = image.dtype.type
        codes = np.floor(image * kind(self.max_code) + kind(0.5))
        rounded: npt.NDArray[Real] = np.minimum(codes / kind(self.max_code), kind(1.0))
        return rounded

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the largest code."""
        return {"steps": float32_array(self.max_code)}


EFFECT_TYPE = EffectType(
    "Quantisation", Quantisation, (EffectParameter("AdcBits", "adc_bits", 12.0, 1.0, 16.0),)
)
