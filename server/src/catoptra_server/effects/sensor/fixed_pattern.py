"""Fixed pattern: pixels differ in gain (PRNU) and dark signal (DSNU), the same in every frame.

L' = L (1 + s_PRNU n_1) + s_DSNU / N n_2, with N the full well in electrons and n_1, n_2 a camera's
own normal variates, one of each for every pixel and colour. Source: EMVA Standard 1288: PRNU as a
fraction of the signal, DSNU in electrons. Domain: any radiance; the pattern of a robot's camera
follows from the server's seed and the robot's name. Criterion: the largest normal variate on the
grey that changes most.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
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
    camera_noise_key,
    max_change_by_offset,
    normal_variates,
)
from catoptra_server.world.objects import NoiseSeed


@dataclass(frozen=True, slots=True)
class FixedPattern:
    """Non-uniformity of a sensor's pixels."""

    prnu: float
    """Standard deviation of the gains; 0.01 is 1 %."""
    dsnu_e: float
    """Standard deviation of the dark signals, electrons."""
    full_well_e: float
    """Electrons of radiance 1."""

    name: ClassVar[str] = "FixedPattern"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def gains(self) -> Gains:
        """The least and the most sensitive pixel."""
        spread = MAX_NORMAL_VARIATE * self.prnu
        return max(0.0, 1.0 - spread), 1.0 + spread

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change by the largest normal variate of the grey that changes most."""
        # Both variates at their maximum in one pixel: never exceeded, though hardly ever reached.
        dark = self.dsnu_e / self.full_well_e
        value = max_change_by_offset(
            lambda radiance: MAX_NORMAL_VARIATE * (self.prnu * radiance + dark),
            summary,
        )
        reason = f"pixels differ by {100 * self.prnu:.3g} % of gain and {self.dsnu_e:.3g} electrons"
        return EffectBound(value, reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the most sensitive pixel."""
        gain = 1.0 + MAX_NORMAL_VARIATE * self.prnu
        dark = MAX_NORMAL_VARIATE * self.dsnu_e / self.full_well_e
        return replace(summary, max_radiance=gain * summary.max_radiance + dark)

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Apply each pixel's gain and dark signal to the image."""
        seed = NoiseSeed(context.noise_seed.camera_key)
        gain, offset = gain_and_offset_maps(self, seed, *image.shape[:2])
        return image * gain.astype(image.dtype) + offset.astype(image.dtype)


@lru_cache(maxsize=4)
def gain_and_offset_maps(
    effect: FixedPattern, seed: NoiseSeed, height: int, width: int
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Gains and offsets of a camera's pixels, (h, w, 3)."""
    # The seed has no tick here: with one the cache would miss in every frame.
    # Two streams: with one key sensitive pixels would also be the bright ones in the dark.
    gain_variates = normal_variates(camera_noise_key(seed, "PRNU"), height, width)
    dark_variates = normal_variates(camera_noise_key(seed, "DSNU"), height, width)
    gain = 1.0 + np.float32(effect.prnu) * gain_variates
    return gain, np.float32(effect.dsnu_e / effect.full_well_e) * dark_variates


EFFECT_TYPE = EffectType(
    "FixedPattern",
    FixedPattern,
    (
        EffectParameter("Prnu", "prnu", 0.01, 0.0, 0.5),
        EffectParameter("Dsnu", "dsnu_e", 2.0, 0.0, 1e5),
        EffectParameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),
    ),
)
