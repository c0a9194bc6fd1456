"""Quantisation: the converter has 2^bits - 1 steps of equal radiance, and none above white.

L' = min(floor((2^b - 1) L + 1/2) / (2^b - 1), 1). Negative codes are kept, as a converter keeps
them by a black level that is subtracted later. Source: EMVA Standard 1288, the linear camera model:
a variance of 1/12 of a squared step. Domain: any radiance, 1 to 16 bits. Criterion: half a step in
the dark, where the sRGB curve is steepest: 12 bits stay below half a grey level, 8 bits do not.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    UNCHANGED,
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_offset


@dataclass(frozen=True, slots=True)
class Quantisation:
    """Resolution of the analogue-to-digital converter."""

    adc_bits: float
    """Bits of a code, a whole number."""

    name: ClassVar[str] = "Quantisation"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = UNCHANGED
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def max_code(self) -> float:
        """Code of white."""
        return float(2 ** int(self.adc_bits) - 1)

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change by half a step of the grey that changes most."""
        value = max_change_by_offset(
            lambda radiance: np.full_like(radiance, 0.5 / self.max_code), summary
        )
        return EffectBound(value, f"a converter of {int(self.adc_bits)} bits")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the brightest light rounded up, at most white."""
        # Clipped, as by the converter: read noise may have raised a full well above white.
        rounded = summary.max_radiance + 0.5 / self.max_code
        return replace(summary, max_radiance=min(rounded, 1.0))

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Round the image to the converter's codes."""
        real = image.dtype.type
        # floor(x + 1/2), not rint: halves round up, as in the kernel's stage.
        codes = np.floor(image * real(self.max_code) + real(0.5))
        quantised: npt.NDArray[Real] = np.minimum(codes / real(self.max_code), real(1.0))
        return quantised


EFFECT_TYPE = EffectType(
    "Quantisation", Quantisation, (EffectParameter("AdcBits", "adc_bits", 12.0, 1.0, 16.0),)
)
