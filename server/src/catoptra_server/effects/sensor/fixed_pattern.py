"""Fixed pattern: pixels differ in gain (PRNU) and in dark signal (DSNU), the same in every frame.

L' = L (1 + s_PRNU n_1) + s_DSNU / N n_2, with N the full well in electrons and n_1, n_2 a camera's
own normal numbers, one of each a pixel and colour. Source: EMVA Standard 1288: PRNU as a share of
the signal, DSNU in electrons. Domain: any light; the pattern of a robot's camera follows from the
server's seed and its name. Criterion: the largest normal number on the grey that shows it most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.noise_seed import NoiseSeed
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
    camera_noise_key,
    normal_variates,
)
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class FixedPattern:
    """prnu: standard deviation of gains, 1 = 100 %. dsnu_e: of dark signals, electrons."""

    prnu: float
    dsnu_e: float
    full_well_e: float

    name: ClassVar[str] = "FixedPattern"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what the largest normal number does to the grey that shows it most."""
        dark = self.dsnu_e / self.full_well_e
        value = max_change_by_offset(
            lambda light: MAX_NORMAL_VARIATE * (self.prnu * light + dark), summary.max_radiance
        )
        spread = f"pixels differ by {100 * self.prnu:.3g} % of gain and {self.dsnu_e:.3g} electrons"
        return EffectBound(value, spread)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the most sensitive pixel."""
        gain = 1.0 + MAX_NORMAL_VARIATE * self.prnu
        dark = MAX_NORMAL_VARIATE * self.dsnu_e / self.full_well_e
        return replace(summary, max_radiance=gain * summary.max_radiance + dark)

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture as unequal pixels measure it."""
        gain, offset = _gain_and_offset_maps(
            self, NoiseSeed(context.noise_seed.camera_key), *image.shape[:2]
        )
        return image * gain.astype(image.dtype) + offset.astype(image.dtype)

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return both spreads, and the words of their numbers."""
        return {
            "spread": float32_array(self.prnu, self.dsnu_e / self.full_well_e),
            "gain_words": camera_noise_key(context.noise_seed, "PRNU"),
            "offset_words": camera_noise_key(context.noise_seed, "DSNU"),
        }


@lru_cache(maxsize=4)
def _gain_and_offset_maps(
    effect: FixedPattern, seed: NoiseSeed, height: int, width: int
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return a camera's (h, w, 3) gains and offsets; kept, because they never change."""
    gain = 1.0 + np.float32(effect.prnu) * normal_variates(
        camera_noise_key(seed, "PRNU"), height, width
    )
    dark = np.float32(effect.dsnu_e / effect.full_well_e)
    return gain, dark * normal_variates(camera_noise_key(seed, "DSNU"), height, width)


EFFECT_TYPE = EffectType(
    "FixedPattern",
    FixedPattern,
    (
        EffectParameter("Prnu", "prnu", 0.01, 0.0, 0.5),
        EffectParameter("Dsnu", "dsnu_e", 2.0, 0.0, 1e5),
        EffectParameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),
    ),
)
