"""f-theta lens of NVIDIA: the angle as a polynomial of the radius, theta = k1 r + ... + k4 r^4.

Source: NVIDIA Isaac Sim and DriveWorks, `fthetaPoly`; r in pixels of the calibrated image, so the
scale is 1 at that size. Domain: to 180 degrees, or to where the angle stops growing with the
radius: the fold of this model.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.curves import first_root, solve_increasing, tabulate
from catoptra_protocol.optics.elementary import arctan, tan
from catoptra_protocol.optics.lenses.angle_polynomial import AnglePolynomial, half_angle_from_theta
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class FThetaLens(CentredLens):
    """Lens whose angle is a polynomial of the image radius, in pixels."""

    k1: float
    """Radians per pixel on the axis, > 0."""
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    def __post_init__(self) -> None:
        # Built here so that an impossible coefficient is found at once.
        _ = self._polynomial

    @property
    def _polynomial(self) -> AnglePolynomial:
        # The same numerics with radius and angle exchanged.
        return AnglePolynomial((self.k1, self.k2, self.k3, self.k4))

    @property
    def fold_rad(self) -> float:
        """Angle that the polynomial does not exceed; inf if it reaches 180 degrees."""
        radius, is_fold = _last_radius(self)
        return float(self._polynomial.evaluate(np.array(radius))) if is_fold else math.inf

    @property
    def t_limit(self) -> float:
        """Half-angle tangent of the fold; inf without one."""
        return math.inf if math.isinf(self.fold_rad) else tan(0.5 * self.fold_rad)

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Radius in calibrated pixels. Domain: 0 <= t <= t_limit."""
        require_angle(t, self.t_limit)
        polynomial = self._polynomial
        theta = 2.0 * arctan(t)
        return solve_increasing(polynomial.evaluate, polynomial.slope, theta, _table(self))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of a radius, inf beyond the last. Domain: ratio >= 0."""
        require_radius(ratio)
        last, _ = _last_radius(self)
        theta = self._polynomial.evaluate(np.minimum(ratio, last))
        return np.where(ratio > last, math.inf, half_angle_from_theta(np.minimum(theta, math.pi)))

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Calibrated pixels per radian. Domain: 0 <= t < t_limit."""
        slope: Floats = 1.0 / self._polynomial.slope(self.radius_ratio_from_t(t))
        return slope


@lru_cache(maxsize=64)
def _last_radius(lens: FThetaLens) -> tuple[float, bool]:
    """Radius of the limit, and whether it is a fold."""
    coefficients = (lens.k1, lens.k2, lens.k3, lens.k4)
    antipode = first_root(np.array((-math.pi, *coefficients)), low=0.0, high=math.inf)
    slope = [power * c for power, c in enumerate(coefficients, 1)]
    fold = first_root(np.array(slope), low=0.0, high=math.inf)
    # A polynomial either folds or grows without limit.
    return (fold, True) if fold < antipode else (antipode, False)


@lru_cache(maxsize=64)
def _table(lens: FThetaLens) -> tuple[Floats, Floats]:
    return tabulate(
        AnglePolynomial((lens.k1, lens.k2, lens.k3, lens.k4)).evaluate, 0.0, _last_radius(lens)[0]
    )
