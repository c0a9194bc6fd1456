"""Image radius as a polynomial of the angle: r = c1 theta + c2 theta^2 + ...

The numerics of the Kannala-Brandt and the WoodScape lens. The polynomial is evaluated by Horner's
scheme without its constant term, so that no digit is lost next to the axis.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.curves import first_root, solve_increasing, tabulate
from catoptra_protocol.optics.elementary import arctan, tan
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass

# Lenses in use at a time; a table has 16 kB.
_NUM_CACHED = 64


@dataclass(frozen=True, slots=True)
class AnglePolynomial:
    """Polynomial without a constant term, increasing from the axis to its first fold."""

    coefficients: tuple[float, ...]
    """Of theta, theta^2, ..."""

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.coefficients)):
            raise DomainError(f"coefficients must be finite: {self.coefficients!r}")
        if not self.coefficients or self.coefficients[0] <= 0.0:
            raise DomainError(
                f"the image radius must grow from the axis on: the factor of theta is "
                f"{self.coefficients[:1]}, expected above 0"
            )

    @property
    def fold_rad(self) -> float:
        """Angle of the first fold up to 180 degrees; inf without one."""
        return _fold_rad(self)

    @property
    def limit_rad(self) -> float:
        """Angle of the first fold, or 180 degrees."""
        return min(self.fold_rad, math.pi)

    def evaluate(self, theta: Floats) -> Floats:
        """Image radius."""
        value = np.full_like(theta, self.coefficients[-1])
        for coefficient in self.coefficients[-2::-1]:
            value = value * theta + coefficient
        return value * theta

    def slope(self, theta: Floats) -> Floats:
        """Derivative by the angle."""
        order = len(self.coefficients)
        value = np.full_like(theta, order * self.coefficients[-1])
        for power in range(order - 1, 0, -1):
            value = value * theta + power * self.coefficients[power - 1]
        return value

    def solve(self, radius: Floats) -> Floats:
        """Angle of an image radius; inf beyond the limit's."""
        table = _table(self)
        theta = solve_increasing(self.evaluate, self.slope, radius, table)
        return np.where(radius > table[1][-1], math.inf, theta)


@lru_cache(maxsize=_NUM_CACHED)
def _fold_rad(polynomial: AnglePolynomial) -> float:
    slope = [power * c for power, c in enumerate(polynomial.coefficients, 1)]
    return first_root(np.array(slope), low=0.0, high=math.pi)


@lru_cache(maxsize=_NUM_CACHED)
def _table(polynomial: AnglePolynomial) -> tuple[Floats, Floats]:
    return tabulate(polynomial.evaluate, 0.0, polynomial.limit_rad)


def half_angle_from_theta(theta: Floats) -> Floats:
    """t = tan(theta / 2); inf for inf."""
    within = theta <= math.pi
    return np.where(within, tan(0.5 * np.where(within, theta, 0.0)), math.inf)


class PolynomialLens(CentredLens, ABC):
    """Lens whose image radius is a polynomial of the angle: all but its coefficients."""

    __slots__ = ()

    def __post_init__(self) -> None:
        # Built here so that an impossible coefficient is found at once.
        _ = self._polynomial

    @property
    def fold_rad(self) -> float:
        """Angle at which the polynomial turns back; inf if it does not up to 180 degrees."""
        return self._polynomial.fold_rad

    @property
    def t_limit(self) -> float:
        """Half-angle tangent of the first fold; inf without one."""
        return math.inf if math.isinf(self.fold_rad) else tan(0.5 * self.fold_rad)

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Image radius in units of the scale. Domain: t >= 0."""
        require_angle(t, self.t_limit)
        return self._polynomial.evaluate(2.0 * arctan(t))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of a radius, inf beyond the first fold. Domain: ratio >= 0."""
        require_radius(ratio)
        return half_angle_from_theta(self._polynomial.solve(ratio))

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative of the image radius by the angle. Domain: t >= 0."""
        require_angle(t, self.t_limit)
        return self._polynomial.slope(2.0 * arctan(t))

    @property
    @abstractmethod
    def _polynomial(self) -> AnglePolynomial:
        """Image radius by the angle."""
