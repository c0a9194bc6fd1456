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

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    Bound,
    Kind,
    Parameter,
    Real,
    Uniforms,
    floats,
)
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.grey_levels import change_by_offset


@dataclass(frozen=True, slots=True)
class Quantisation:
    """adc_bits: the converter's, a whole number."""

    adc_bits: float

    name: ClassVar[str] = "Quantisation"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    @property
    def steps(self) -> float:
        """Return the largest code."""
        return float(2 ** int(self.adc_bits) - 1)

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return what half a step is in the dark."""
        value = change_by_offset(
            lambda light: np.full_like(light, 0.5 / self.steps), summary.largest_radiance
        )
        return Bound(value, f"a converter of {int(self.adc_bits)} bits")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of what was rounded up."""
        return replace(
            summary, largest_radiance=min(summary.largest_radiance + 0.5 / self.steps, 1.0)
        )

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the rounded picture."""
        kind = light.dtype.type
        codes = np.floor(light * kind(self.steps) + kind(0.5))
        rounded: npt.NDArray[Real] = np.minimum(codes / kind(self.steps), kind(1.0))
        return rounded

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the largest code."""
        return {"steps": floats(self.steps)}


KIND = Kind("Quantisation", Quantisation, (Parameter("AdcBits", "adc_bits", 12.0, 1.0, 16.0),))
