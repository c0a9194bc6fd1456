"""Stereographic lens: conformal, r = 2 f tan(theta / 2).

Source: Fleck 1995. Domain: 0 to below 180 degrees. The paper's Eq. 2 has the same form, with h = 2
f.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.elementary import tan
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats, has_finite_square, require_domain
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class StereographicLens(CentredLens):
    """Lens with r = 2 f tan(theta / 2); the focal length is the scale."""

    @property
    def t_limit(self) -> float:
        """The antipode's tangent as a float: its image radius is infinite."""
        return tan(0.5 * math.pi)

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f = 2 t. Domain: 0 <= t < inf."""
        expected = "an image radius needs a finite t = tan(theta / 2) >= 0"
        require_domain((t >= 0.0) & (t < math.inf), t, expected)
        return 2.0 * t

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent r / 2f. Domain: ratio >= 0."""
        require_radius(ratio)
        return 0.5 * ratio

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta) = 1 + t^2. Domain: t >= 0 with a finite square."""
        inside = (t >= 0.0) & has_finite_square(t)
        require_domain(inside, t, "a slope needs t >= 0 with a finite square")
        slope: Floats = 1.0 + np.square(t)
        return slope
