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
class ShotNoise:
    """full_well_e: the electrons of white."""

    full_well_e: float

    name: ClassVar[str] = "ShotNoise"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return what the largest normal number does to the grey that shows it most."""
        value = change_by_offset(
            lambda light: LARGEST_NORMAL * np.sqrt(light / self.full_well_e),
            summary.largest_radiance,
        )
        electrons = self.full_well_e * min(summary.largest_radiance, 1.0)
        return Bound(value, f"{electrons:.0f} electrons in the brightest pixel")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the noisiest pixel; no well holds more than is full."""
        largest = summary.largest_radiance
        noisy = largest + LARGEST_NORMAL * float(np.sqrt(largest / self.full_well_e))
        return replace(summary, largest_radiance=min(noisy, 1.0))

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the noisy picture."""
        drawn = normals(frame_words(capture.key, self.name), *light.shape[:2]).astype(light.dtype)
        scale = light.dtype.type(1.0 / self.full_well_e)
        spread = np.sqrt(np.maximum(light, light.dtype.type(0.0)) * scale)
        return np.minimum(light + spread * drawn, light.dtype.type(1.0))

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the light of an electron, and the words of the frame's numbers."""
        return {
            "electron": floats(1.0 / self.full_well_e),
            "words": frame_words(capture.key, self.name),
        }


KIND = Kind("ShotNoise", ShotNoise, (Parameter("FullWell", "full_well_e", 18000.0, 1.0, 1e12),))
