"""Read noise: the amplifier adds its own, whatever the light.

L' = L + s / N n, s the read noise and N the full well in electrons, n normal. Negative light is
kept until the picture is encoded, as converters keep it by a black level. Source: EMVA Standard
1288, the linear camera model: the variance sigma_d^2 of the dark. Domain: any light. Criterion: the
largest normal number in the dark, where the sRGB curve is steepest.
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
from catoptra_server.effects.kernels.noise import (
    MAX_NORMAL_VARIATE,
    frame_noise_key,
    normal_variates,
)
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class ReadNoise:
    """read_noise_e: standard deviation, electrons. full_well_e: the electrons of white."""

    read_noise_e: float
    full_well_e: float

    name: ClassVar[str] = "ReadNoise"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    @property
    def standard_deviation(self) -> float:
        """Return the standard deviation in light."""
        return self.read_noise_e / self.full_well_e

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what the largest normal number does in the dark."""
        value = max_change_by_offset(
            lambda light: np.full_like(light, MAX_NORMAL_VARIATE * self.standard_deviation),
            summary.max_radiance,
        )
        return EffectBound(
            value, f"{self.read_noise_e:.3g} electrons beside {self.full_well_e:.0f} of white"
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the noisiest pixel."""
        return replace(
            summary,
            max_radiance=summary.max_radiance + MAX_NORMAL_VARIATE * self.standard_deviation,
        )

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the noisy picture."""
        drawn = normal_variates(
            frame_noise_key(context.noise_seed, self.name), *image.shape[:2]
        ).astype(image.dtype)
        return image + image.dtype.type(self.standard_deviation) * drawn

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the spread, and the words of the frame's numbers."""
        return {
            "spread": float32_array(self.standard_deviation),
            "words": frame_noise_key(context.noise_seed, self.name),
        }


EFFECT_TYPE = EffectType(
    "ReadNoise",
    ReadNoise,
    (
        EffectParameter("ReadNoiseElectrons", "read_noise_e", 13.0, 0.0, 1e5),
        EffectParameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),
    ),
)
