"""Blooming: charge above the full well runs over into the pixels above and below, as in a CCD.

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
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class Blooming:
    """share: of the charge above the full well that runs over. length_px: how far, whole pixels."""

    overflow_fraction: float
    length_px: float

    name: ClassVar[str] = "Blooming"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what black gains where the brightest light stands above and below."""
        largest = summary.max_radiance
        share = f"the brightest light is {largest:.3g} of the full well"
        return EffectBound(grey_level(self.overflow_fraction * max(largest - 1.0, 0.0)), share)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the brightest light between two of its like."""
        over = max(summary.max_radiance - 1.0, 0.0)
        return replace(summary, max_radiance=summary.max_radiance + self.overflow_fraction * over)

    def weights(self) -> tuple[float, ...]:
        """Return w_k of k = 1 .. n; both sides together have 1."""
        rows = int(self.length_px)
        return tuple((rows + 1 - k) / (rows * (rows + 1)) for k in range(1, rows + 1))

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture with what runs over."""
        over = np.maximum(image - image.dtype.type(1.0), image.dtype.type(0.0))
        bloomed = image.copy()
        columns = np.flatnonzero(over.any(axis=(0, 2)))
        source = image.dtype.type(self.overflow_fraction) * over[:, columns]
        gained = np.zeros_like(source)
        for k, weight in enumerate(self.weights(), 1):
            gained[k:] += image.dtype.type(weight) * source[:-k]
            gained[:-k] += image.dtype.type(weight) * source[k:]
        bloomed[:, columns] += gained
        return bloomed

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return share and length."""
        return {
            "share": float32_array(self.overflow_fraction),
            "length_px": float32_array(int(self.length_px)),
        }


EFFECT_TYPE = EffectType(
    "Blooming",
    Blooming,
    (
        EffectParameter("BloomingFraction", "overflow_fraction", 0.1, 0.0, 1.0),
        EffectParameter("BloomingLength", "length_px", 8.0, 1.0, 256.0),
    ),
)
