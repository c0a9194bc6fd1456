"""Bloom: charge above the full well runs over into the pixels above and below, as in a CCD.

L' = L + share * sum over k = +-1 .. +-n of w_k max(L_k - 1, 0), L_k the pixel k rows away, w_k
falling linearly from its neighbour to nothing, sum 1. The share is what the anti-blooming drain
leaves. What runs over runs on nowhere: charge is not counted twice. Domain: any light; beyond the
picture's border nothing runs back. Source: CCDs bloom along their columns; the linear fall is ours.
Criterion: nothing unless the scene's brightest light can fill a well; then what black gains beside
it.
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
from catoptra_server.effects.shared.grey_levels import grey_level


@dataclass(frozen=True, slots=True)
class Bloom:
    """share: of the charge above the full well that runs over. length_px: how far, whole pixels."""

    share: float
    length_px: float

    name: ClassVar[str] = "Bloom"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return what black gains where the brightest light stands above and below."""
        largest = summary.largest_radiance
        share = f"the brightest light is {largest:.3g} of the full well"
        return Bound(grey_level(self.share * max(largest - 1.0, 0.0)), share)

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the brightest light between two of its like."""
        over = max(summary.largest_radiance - 1.0, 0.0)
        return replace(summary, largest_radiance=summary.largest_radiance + self.share * over)

    def weights(self) -> tuple[float, ...]:
        """Return w_k of k = 1 .. n; both sides together have 1."""
        rows = int(self.length_px)
        return tuple((rows + 1 - k) / (rows * (rows + 1)) for k in range(1, rows + 1))

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the picture with what runs over."""
        over = np.maximum(light - light.dtype.type(1.0), light.dtype.type(0.0))
        bloomed = light.copy()
        columns = np.flatnonzero(over.any(axis=(0, 2)))
        source = light.dtype.type(self.share) * over[:, columns]
        gained = np.zeros_like(source)
        for k, weight in enumerate(self.weights(), 1):
            gained[k:] += light.dtype.type(weight) * source[:-k]
            gained[:-k] += light.dtype.type(weight) * source[k:]
        bloomed[:, columns] += gained
        return bloomed

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return share and length."""
        return {"share": floats(self.share), "length_px": floats(int(self.length_px))}


KIND = Kind(
    "Bloom",
    Bloom,
    (
        Parameter("BloomShare", "share", 0.1, 0.0, 1.0),
        Parameter("BloomLength", "length_px", 8.0, 1.0, 256.0),
    ),
)
