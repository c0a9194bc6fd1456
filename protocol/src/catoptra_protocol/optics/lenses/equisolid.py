"""Equisolid lens: equal solid angles have equal areas, r = 2 f sin(theta / 2).

Source: Miyamoto 1964. Domain: 0 to 180 degrees. A sphere under a telecentric camera has the same
projection.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class EquisolidLens(CentredLens):
    """Lens with r = 2 f sin(theta / 2); the focal length is the scale."""

    @property
    def t_limit(self) -> float:
        """Infinity: the image may contain the antipode, as a circle."""
        return math.inf

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f = 2 t / sqrt(1 + t^2). Domain: t >= 0."""
        require_angle(t, self.t_limit)
        # hypot is finite for any t.
        radius: Floats = 2.0 * (t / hypot(1.0, t))
        return radius

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent s / sqrt(1 - s^2) with s = r / 2f, inf from the antipode on.

        Domain: ratio >= 0.
        """
        require_radius(ratio)
        sine = 0.5 * np.minimum(ratio, 2.0)
        cosine = np.sqrt((1.0 - sine) * (1.0 + sine))
        inside = cosine > 0.0
        return np.where(inside, sine / np.where(inside, cosine, 1.0), math.inf)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta) = cos(theta / 2). Domain: t >= 0."""
        require_angle(t, self.t_limit)
        slope: Floats = 1.0 / hypot(1.0, t)
        return slope
