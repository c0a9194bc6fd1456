"""Shot noise: photons come one by one, so a pixel of mu electrons has a variance of mu.

L' = min(L + sqrt(L / N) n, 1), N the full well in electrons, n normal: mu = N L, sigma^2 = mu. A
full well holds no more, and has no noise of its own. Source: EMVA Standard 1288, the linear camera
model, with its Poisson law replaced by the normal one of the same mean and variance. Domain: any
light; below some 20 electrons the Poisson law is visibly skewed and this is not. Criterion: the
largest normal number on the grey that shows it most.
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
class ShotNoise:
    """full_well_e: the electrons of white."""

    full_well_e: float

    name: ClassVar[str] = "ShotNoise"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what the largest normal number does to the grey that shows it most."""
        value = max_change_by_offset(
            lambda light: MAX_NORMAL_VARIATE * np.sqrt(light / self.full_well_e),
            summary.max_radiance,
        )
        electrons = self.full_well_e * min(summary.max_radiance, 1.0)
        return EffectBound(value, f"{electrons:.0f} electrons in the brightest pixel")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the noisiest pixel; no well holds more than is full."""
        largest = summary.max_radiance
        noisy = largest + MAX_NORMAL_VARIATE * float(np.sqrt(largest / self.full_well_e))
        return replace(summary, max_radiance=min(noisy, 1.0))

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the noisy picture."""
        drawn = normal_variates(
            frame_noise_key(context.noise_seed, self.name), *image.shape[:2]
        ).astype(image.dtype)
        scale = image.dtype.type(1.0 / self.full_well_e)
        spread = np.sqrt(np.maximum(image, image.dtype.type(0.0)) * scale)
        return np.minimum(image + spread * drawn, image.dtype.type(1.0))

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the light of an electron, and the words of the frame's numbers."""
        return {
            "electron": float32_array(1.0 / self.full_well_e),
            "words": frame_noise_key(context.noise_seed, self.name),
        }


EFFECT_TYPE = EffectType(
    "ShotNoise", ShotNoise, (EffectParameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),)
)
