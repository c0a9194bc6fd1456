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
from catoptra_server.effects.frame_key import FrameKey
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.grey_levels import change_by_offset
from catoptra_server.effects.shared.noise import LARGEST_NORMAL, camera_words, normals


@dataclass(frozen=True, slots=True)
class FixedPattern:
    """prnu: standard deviation of gains, 1 = 100 %. dsnu_e: of dark signals, electrons."""

    prnu: float
    dsnu_e: float
    full_well_e: float

    name: ClassVar[str] = "FixedPattern"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return what the largest normal number does to the grey that shows it most."""
        dark = self.dsnu_e / self.full_well_e
        value = change_by_offset(
            lambda light: LARGEST_NORMAL * (self.prnu * light + dark), summary.largest_radiance
        )
        spread = f"pixels differ by {100 * self.prnu:.3g} % of gain and {self.dsnu_e:.3g} electrons"
        return Bound(value, spread)

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the most sensitive pixel."""
        gain = 1.0 + LARGEST_NORMAL * self.prnu
        dark = LARGEST_NORMAL * self.dsnu_e / self.full_well_e
        return replace(summary, largest_radiance=gain * summary.largest_radiance + dark)

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the picture as unequal pixels measure it."""
        gain, offset = _pattern(self, FrameKey(capture.key.camera), *light.shape[:2])
        return light * gain.astype(light.dtype) + offset.astype(light.dtype)

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return both spreads, and the words of their numbers."""
        return {
            "spread": floats(self.prnu, self.dsnu_e / self.full_well_e),
            "gain_words": camera_words(capture.key, "PRNU"),
            "offset_words": camera_words(capture.key, "DSNU"),
        }


@lru_cache(maxsize=4)
def _pattern(
    effect: FixedPattern, key: FrameKey, height: int, width: int
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return a camera's (h, w, 3) gains and offsets; kept, because they never change."""
    gain = 1.0 + np.float32(effect.prnu) * normals(camera_words(key, "PRNU"), height, width)
    dark = np.float32(effect.dsnu_e / effect.full_well_e)
    return gain, dark * normals(camera_words(key, "DSNU"), height, width)


KIND = Kind(
    "FixedPattern",
    FixedPattern,
    (
        Parameter("Prnu", "prnu", 0.01, 0.0, 0.5),
        Parameter("Dsnu", "dsnu_e", 2.0, 0.0, 1e5),
        Parameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),
    ),
)
