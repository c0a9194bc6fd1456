"""Kannala-Brandt lens: r = f theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).

Source: Kannala & Brandt, PAMI 28 (2006), without its asymmetric terms: as in OpenCV's fisheye
module, Kalibr ("equidistant") and Basalt ("kb4"). Domain: 0 to the first fold of the polynomial.
Readers that divide by z, as OpenCV's does, are wrong beyond 90 degrees; here theta is the angle.
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
class KannalaBrandtLens(CentredLens):
    """Lens by an odd polynomial of the angle; the focal length is the scale."""

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    def __post_init__(self) -> None:
        # Built here so that an impossible coefficient is found at once.
        _ = self._polynomial

    @property
    def _polynomial(self) -> AnglePolynomial:
        return AnglePolynomial((1.0, 0.0, self.k1, 0.0, self.k2, 0.0, self.k3, 0.0, self.k4))

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
        """Ratio r / f. Domain: t >= 0."""
        require_angle(t, self.t_limit)
        return self._polynomial.evaluate(2.0 * np.arctan(t))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of r / f, inf beyond the first fold. Domain: ratio >= 0."""
        require_radius(ratio)
        return half_angle_from_theta(self._polynomial.solve(ratio))

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta). Domain: t >= 0."""
        require_angle(t, self.t_limit)
        return self._polynomial.slope(2.0 * np.arctan(t))
