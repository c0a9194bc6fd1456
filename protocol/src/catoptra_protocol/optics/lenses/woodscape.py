"""WoodScape lens: r = k1 theta + k2 theta^2 + k3 theta^3 + k4 theta^4, in pixels.

Source: Yogamani et al., WoodScape, ICCV 2019, `radial_poly` of its calibration files. The unit is
the pixel of the calibrated image, so the scale is 1 at that size. Domain: 0 to the first fold.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.lenses.angle_polynomial import AnglePolynomial, half_angle_from_theta
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class WoodScapeLens(CentredLens):
    """Lens by a polynomial of the angle, in pixels."""

    k1: float
    """Pixels per radian on the axis, > 0."""
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    def __post_init__(self) -> None:
        # Built here so that an impossible coefficient is found at once.
        _ = self._polynomial

    @property
    def _polynomial(self) -> AnglePolynomial:
        return AnglePolynomial((self.k1, self.k2, self.k3, self.k4))

    @property
    def fold_rad(self) -> float:
        """Angle at which the polynomial turns back; inf if it does not up to 180 degrees."""
        return self._polynomial.fold_rad

    @property
    def t_limit(self) -> float:
        """Half-angle tangent of the first fold; inf without one."""
        return math.inf if math.isinf(self.fold_rad) else math.tan(0.5 * self.fold_rad)

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Radius in calibrated pixels. Domain: t >= 0."""
        require_angle(t, self.t_limit)
        return self._polynomial.evaluate(2.0 * np.arctan(t))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of a radius, inf beyond the first fold. Domain: ratio >= 0."""
        require_radius(ratio)
        return half_angle_from_theta(self._polynomial.solve(ratio))

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Calibrated pixels per radian. Domain: t >= 0."""
        require_angle(t, self.t_limit)
        return self._polynomial.slope(2.0 * np.arctan(t))
