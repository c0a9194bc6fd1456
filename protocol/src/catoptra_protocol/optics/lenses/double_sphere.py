"""Double sphere lens: m = rho / (alpha d2 + (1 - alpha) (xi + z)), d2 = |(rho, xi + z)|.

Of a unit direction (rho, z). Source: Usenko, Demmel & Cremers, 3DV 2018; Basalt's "ds". The focal
length is the scale. Domain: (xi + z) > -w1 d2 with w1 of that paper, beyond which no point of the
image lies or its radius turns back, and 1 + xi z > 0 for xi > 1. The paper's own limit z > -w2
takes d2 for 1: for xi < 0 it lies beyond the true one.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import hypot, tan
from catoptra_protocol.optics.lenses.centred_lens import (
    ANGLE_SLACK,
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.lenses.enhanced_unified import project_sphere, unproject_sphere
from catoptra_protocol.optics.numerics import Floats, half_angle_tangent_from_rho_z
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class DoubleSphereLens(CentredLens):
    """Lens by the distances between two spheres and a pinhole."""

    xi: float
    """Distance between the spheres' centres, in radii, > -1."""
    alpha: float
    """Position of the pinhole, 0 to below 1."""

    def __post_init__(self) -> None:
        # Finite although it is squared.
        if not (self.xi > -1.0 and math.isfinite(self.xi * self.xi)):
            raise DomainError(f"a double sphere needs xi > -1 of a finite square, not {self.xi!r}")
        if not 0.0 <= self.alpha < 1.0:
            raise DomainError(f"alpha must be 0 or more and below 1, not {self.alpha!r}")

    @property
    def t_limit(self) -> float:
        """Half-angle tangent at xi + z = -w1 d2, or where 1 + xi z = 0."""
        antipode = tan(0.5 * math.pi)
        if self.xi > 1.0:
            # None for w1: the last angle has 1 + xi z = 0.
            return min(math.sqrt((self.xi + 1.0) / (self.xi - 1.0)), antipode)
        low, high = sorted((self.alpha, 1.0 - self.alpha))
        # (xi + z)^2 = w1^2 (1 + xi^2 + 2 xi z), its solution with xi + z < 0 and u = 1 - w1^2:
        # -z = u xi + w1 sqrt(1 - u xi^2), whence (1 + z) (1 - u xi + w1 sqrt) = u (1 - xi)^2.
        rest = abs(1.0 - 2.0 * self.alpha) / (high * high)
        root = low / high * math.sqrt(1.0 - rest * self.xi * self.xi)
        distance = math.sqrt(rest) * (1.0 - self.xi)
        square = (1.0 + rest * self.xi + root) * (1.0 - rest * self.xi + root)
        return min(math.sqrt(square) / distance, antipode) if distance > 0.0 else antipode

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f. Domain: 0 <= t < t_limit."""
        sine, (denominator, _, _), _ = self.terms(t)
        return sine / denominator

    @np.errstate(over="ignore", under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of r / f, inf where no angle has it. Domain: ratio >= 0."""
        require_radius(ratio)
        x, z, inside = unproject_sphere(ratio, self.alpha)
        size = hypot(x, z)
        x, z = x / size, z / size
        squared = (1.0 - self.xi) * (1.0 + self.xi)
        sphere = np.square(z) + squared * np.square(x)
        root = np.sqrt(np.maximum(sphere, 0.0))
        along = self.xi * z
        # Distance from the second sphere's centre to the first sphere: that which cancels
        # for along < 0 is a quotient.
        length = np.where(along < 0.0, squared / (root + np.abs(along)), root + along)
        inside &= (sphere >= 0.0) & (length >= 0.0)
        # The offset of a point of the first sphere from its centre is a unit vector.
        t, defined = half_angle_tangent_from_rho_z(length * x, length * z - self.xi)
        inside &= defined & (t <= self.t_limit * (1.0 + ANGLE_SLACK))
        return np.where(inside, np.minimum(t, self.t_limit), math.inf)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta). Domain: 0 <= t < t_limit."""
        # (1 + xi cos) ((1 - alpha) d2 + alpha (xi + cos)) / (d2 D^2)
        _, (denominator, d2, numerator), reach = self.terms(t)
        return reach * (numerator / d2) / np.square(denominator)

    def terms(self, t: Floats) -> tuple[Floats, tuple[Floats, Floats, Floats], Floats]:
        """sin, what `project_sphere` has of (sin, xi + cos), and 1 + xi cos."""
        require_angle(t, self.t_limit)
        # cos = 1 - 2 lower = 2 upper - 1: of the two, the one whose terms are not those that
        # cancel at its end of the axis.
        upper = 1.0 / (1.0 + np.square(t))
        sine = 2.0 * t * upper
        lower, is_low = np.square(t) * upper, t > 1.0
        height = np.where(is_low, (self.xi - 1.0) + 2.0 * upper, (self.xi + 1.0) - 2.0 * lower)
        lower, upper = 2.0 * self.xi * lower, 2.0 * self.xi * upper
        reach = np.where(is_low, (1.0 - self.xi) + upper, (1.0 + self.xi) - lower)
        return sine, project_sphere(sine, height, self.alpha), reach
