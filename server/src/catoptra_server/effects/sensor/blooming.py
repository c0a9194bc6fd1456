"""Blooming: charge above the full well overflows into the pixels above and below, as in a CCD.

L' = L + fraction * sum over k = +-1 .. +-n of w_k max(L_k - 1, 0), L_k the pixel k rows away, w_k
falling linearly from the direct neighbour to nothing, sum 1. The fraction is the part that the
anti-blooming drain leaves. Overflow does not overflow again: charge is not counted twice. Domain:
any radiance; nothing flows back from outside the image. Source: CCDs bloom along their columns; the
linear fall is an assumption. Criterion: 0 unless the scene's brightest light can fill a well; else
the gain of black beside that light.
"""

from __future__ import annotations

from dataclasses import replace
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
from catoptra_server.effects.kernels.grey_levels import grey_level


@dataclass(frozen=True, slots=True)
class Blooming:
    """Overflow of a CCD's pixels."""

    overflow_fraction: float
    """Fraction of the charge above the full well that overflows."""
    length_px: float
    """Reach of the overflow in rows, a whole number."""

    name: ClassVar[str] = "Blooming"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def gains(self) -> Gains:
        """Light above the well reaches other pixels besides."""
        return 1.0, 1.0 + self.overflow_fraction

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Gain of a black pixel with the brightest light above and below."""
        # Weights sum to 1 over both sides: a black pixel with saturated columns above and below
        # receives the whole fraction, and no pixel more.
        excess = max(summary.max_radiance - 1.0, 0.0)
        return EffectBound(
            grey_level(summary.gains[1] * self.overflow_fraction * excess),
            f"the brightest light is {summary.max_radiance:.3g} of the full well",
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the brightest light between two pixels of the same radiance."""
        excess = max(summary.max_radiance - 1.0, 0.0)
        return replace(summary, max_radiance=summary.max_radiance + self.overflow_fraction * excess)

    def weights(self) -> tuple[float, ...]:
        """Weights w_k of k = 1 .. n; the sum over both sides is 1."""
        # A triangle: 2 (n + ... + 1) = n (n + 1) makes both sides sum to 1.
        rows = int(self.length_px)
        return tuple((rows + 1 - k) / (rows * (rows + 1)) for k in range(1, rows + 1))

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Add the overflow to the image."""
        excess = np.maximum(image - image.dtype.type(1.0), image.dtype.type(0.0))
        result = image.copy()
        # Most columns have no saturated pixel; sums over 2 n shifted copies skip those columns.
        columns = np.flatnonzero(excess.any(axis=(0, 2)))
        source = image.dtype.type(self.overflow_fraction) * excess[:, columns]
        overflow = np.zeros_like(source)
        for k, weight in enumerate(self.weights(), 1):
            overflow[k:] += image.dtype.type(weight) * source[:-k]
            overflow[:-k] += image.dtype.type(weight) * source[k:]
        result[:, columns] += overflow
        return result


EFFECT_TYPE = EffectType(
    "Blooming",
    Blooming,
    (
        EffectParameter("BloomingFraction", "overflow_fraction", 0.1, 0.0, 1.0),
        EffectParameter("BloomingLength", "length_px", 8.0, 1.0, 256.0),
    ),
)
