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
from catoptra_server.effects.shared.noise import LARGEST_NORMAL, frame_words, normals


@dataclass(frozen=True, slots=True)
class ReadNoise:
    """read_noise_e: standard deviation, electrons. full_well_e: the electrons of white."""

    read_noise_e: float
    full_well_e: float

    name: ClassVar[str] = "ReadNoise"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    @property
    def spread(self) -> float:
        """Return the standard deviation in light."""
        return self.read_noise_e / self.full_well_e

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return what the largest normal number does in the dark."""
        value = change_by_offset(
            lambda light: np.full_like(light, LARGEST_NORMAL * self.spread),
            summary.largest_radiance,
        )
        return Bound(
            value, f"{self.read_noise_e:.3g} electrons beside {self.full_well_e:.0f} of white"
        )

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the noisiest pixel."""
        return replace(
            summary, largest_radiance=summary.largest_radiance + LARGEST_NORMAL * self.spread
        )

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the noisy picture."""
        drawn = normals(frame_words(capture.key, self.name), *light.shape[:2]).astype(light.dtype)
        return light + light.dtype.type(self.spread) * drawn

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the spread, and the words of the frame's numbers."""
        return {"spread": floats(self.spread), "words": frame_words(capture.key, self.name)}


KIND = Kind(
    "ReadNoise",
    ReadNoise,
    (
        Parameter("ReadNoiseElectrons", "read_noise_e", 13.0, 0.0, 1e5),
        Parameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),
    ),
)
