"""Read noise: the amplifier adds noise of its own, independent of the signal.

L' = L + s / N n, s the read noise and N the full well in electrons, n a normal variate. Negative
values are kept until the image is encoded, as converters keep them by a black level. Source: EMVA
Standard 1288, the linear camera model: the variance sigma_d^2 of the dark signal. Domain: any
radiance. Criterion: the largest normal variate in the dark, where the sRGB curve is steepest.
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
class ReadNoise:
    """Noise of a sensor's amplifier."""

    read_noise_e: float
    """Standard deviation, electrons."""
    full_well_e: float
    """Electrons of radiance 1."""

    name: ClassVar[str] = "ReadNoise"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = UNCHANGED
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def standard_deviation(self) -> float:
        """Standard deviation in radiance."""
        return self.read_noise_e / self.full_well_e

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change by the largest normal variate of the grey that changes most."""
        value = max_change_by_offset(
            lambda radiance: np.full_like(radiance, MAX_NORMAL_VARIATE * self.standard_deviation),
            summary,
        )
        return EffectBound(
            value, f"{self.read_noise_e:.3g} electrons, white has {self.full_well_e:.0f}"
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the noisiest pixel."""
        # Not clipped at white: the converter behind the amplifier does that.
        noise = MAX_NORMAL_VARIATE * self.standard_deviation
        return replace(summary, max_radiance=summary.max_radiance + noise)

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Add amplifier noise."""
        # The effect's name is the purpose in the key: shot noise of the same frame is independent.
        key = frame_noise_key(context.noise_seed, self.name)
        variates = normal_variates(key, *image.shape[:2]).astype(image.dtype)
        return image + image.dtype.type(self.standard_deviation) * variates


EFFECT_TYPE = EffectType(
    "ReadNoise",
    ReadNoise,
    (
        EffectParameter("ReadNoiseElectrons", "read_noise_e", 13.0, 0.0, 1e5),
        EffectParameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),
    ),
)
