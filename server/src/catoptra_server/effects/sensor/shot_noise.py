"""Shot noise: photons arrive independently, so a pixel of mu electrons has a variance of mu.

L' = min(L + sqrt(L / N) n, 1), N the full well in electrons, n a normal variate: mu = N L,
sigma^2 = mu. A full well holds no more electrons and has no noise. Source: EMVA Standard 1288, the
linear camera model, with the Poisson distribution replaced by the normal one of the same mean and
variance. Domain: any radiance; below some 20 electrons the Poisson distribution is visibly skewed
and this one is not. Criterion: the largest normal variate on the grey that changes most.
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
from catoptra_server.effects.kernels.grey_levels import (
    MAX_NORMAL_VARIATE,
    frame_noise_key,
    max_change_by_offset,
    normal_variates,
)


@dataclass(frozen=True, slots=True)
class ShotNoise:
    """Photon noise of a sensor."""

    full_well_e: float
    """Electrons of radiance 1."""

    name: ClassVar[str] = "ShotNoise"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = UNCHANGED
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change by the largest normal variate of the grey that changes most."""
        value = max_change_by_offset(
            lambda radiance: MAX_NORMAL_VARIATE * np.sqrt(radiance / self.full_well_e),
            summary,
        )
        electrons = self.full_well_e * min(summary.max_radiance, 1.0)
        # In electrons, since the signal-to-noise ratio is the square root of their number.
        return EffectBound(value, f"{electrons:.0f} electrons in the brightest pixel")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the noisiest pixel, at most a full well."""
        brightest = summary.max_radiance
        noise = MAX_NORMAL_VARIATE * float(np.sqrt(brightest / self.full_well_e))
        return replace(summary, max_radiance=min(brightest + noise, 1.0))

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Add photon noise and clip at the full well."""
        key = frame_noise_key(context.noise_seed, self.name)
        variates = normal_variates(key, *image.shape[:2]).astype(image.dtype)
        scale = image.dtype.type(1.0 / self.full_well_e)
        # The dark offset of the fixed pattern may leave a pixel below 0: no photons, no noise.
        deviation = np.sqrt(np.maximum(image, image.dtype.type(0.0)) * scale)
        return np.minimum(image + deviation * variates, image.dtype.type(1.0))


EFFECT_TYPE = EffectType(
    "ShotNoise", ShotNoise, (EffectParameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),)
)
