"""Orthographic lens: r = f sin(theta), a hemisphere seen from afar.

Source: Miyamoto 1964. Domain: 0 to below 90 degrees, where the image radius stops growing.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class OrthographicLens(CentredLens):
    """Lens with r = f sin(theta); the focal length is the scale."""

    @property
    def t_limit(self) -> float:
        """1: 90 degrees."""
        return 1.0

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f = 2 t / (1 + t^2). Domain: 0 <= t <= 1."""
        require_angle(t, self.t_limit)
        return 2.0 * t / (1.0 + t * t)

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent r / (f + sqrt(f^2 - r^2)), inf beyond the focal length.

        Domain: ratio >= 0.
        """
        require_radius(ratio)
        sine = np.minimum(ratio, 1.0)
        t = sine / (1.0 + np.sqrt((1.0 - sine) * (1.0 + sine)))
        return np.where(ratio > 1.0, math.inf, t)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta) = cos(theta). Domain: 0 <= t <= 1."""
        require_angle(t, self.t_limit)
        return (1.0 - t) * (1.0 + t) / (1.0 + t * t)
