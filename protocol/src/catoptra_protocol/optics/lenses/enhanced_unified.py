"""Unified and enhanced unified lens: m = rho / (alpha d + (1 - alpha) z), d^2 = beta rho^2 + z^2.

Source: Khomutenko et al., RA-L 2016 (EUCM); beta = 1 is the unified model in Basalt's form (UCM),
the sphere of xi = alpha / (1 - alpha). The focal length is the scale. Domain: z > -w d with w =
alpha / (1 - alpha), or its inverse for alpha > 1/2, where the image radius turns back.

A sum a d + b z with z < 0 is the quotient (a^2 beta rho^2 + (a - b) (a + b) z^2) / (a d - b z):
it cancels next to 180 degrees where alpha is close to 1/2, the quotient does not.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import hypot, tan
from catoptra_protocol.optics.lenses.centred_lens import (
    ANGLE_SLACK,
    CentredLens,
    require_radius,
)
from catoptra_protocol.optics.numerics import (
    Bools,
    Floats,
    half_angle_tangent_from_rho_z,
    has_finite_square,
    require_domain,
)
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class EnhancedUnifiedLens(CentredLens):
    """Lens by EUCM's two parameters."""

    alpha: float
    """0 (a pinhole) to 1."""
    beta: float = 1.0
    """Shape of the ellipsoid, > 0; 1 is the sphere of UCM."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.alpha <= 1.0:
            raise DomainError(f"alpha must lie between 0 and 1, not {self.alpha!r}")
        if not (math.isfinite(self.beta) and self.beta > 0.0):
            raise DomainError(f"beta must be above 0, not {self.beta!r}")

    @property
    def t_limit(self) -> float:
        """Half-angle tangent at z = -w d."""
        # tan^2(theta) = (1 - w^2) / (beta w^2), theta above 90 degrees; |1 - 2 alpha| is exact.
        sine = math.sqrt(abs(1.0 - 2.0 * self.alpha))
        low = math.sqrt(self.beta) * min(self.alpha, 1.0 - self.alpha)
        antipode = tan(0.5 * math.pi)
        return min((hypot(sine, low) + low) / sine, antipode) if sine > 0.0 else antipode

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f. Domain: 0 <= t < t_limit."""
        return 2.0 * t / self._terms(t)[0]

    @np.errstate(over="ignore", under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of r / f, inf where no angle has it. Domain: ratio >= 0."""
        require_radius(ratio)
        root_beta = math.sqrt(self.beta)
        x, z, inside = unproject_sphere(root_beta * ratio, self.alpha)
        t, defined = half_angle_tangent_from_rho_z(x / root_beta, z)
        inside &= defined & (t <= self.t_limit * (1.0 + ANGLE_SLACK))
        return np.where(inside, np.minimum(t, self.t_limit), math.inf)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta). Domain: 0 <= t < t_limit, with a finite square."""
        # ((1 - alpha) d + alpha cos) / (d D^2), all of a unit direction.
        denominator, d, numerator = self._terms(t)
        return numerator / d * np.square((1.0 + np.square(t)) / denominator)

    def _terms(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        """alpha d + (1 - alpha) z, d and (1 - alpha) d + alpha z, times 1 + t^2."""
        inside = (t >= 0.0) & (t <= self.t_limit) & has_finite_square(t)
        require_domain(inside, t, "an image radius needs 0 <= t = tan(theta / 2) within the limit")
        z = (1.0 - t) * (1.0 + t)
        x = 2.0 * math.sqrt(self.beta) * t
        return project_sphere(x, z, self.alpha)


def project_sphere(x: Floats, z: Floats, alpha: float) -> tuple[Floats, Floats, Floats]:
    """alpha d + (1 - alpha) z, d = |(x, z)| and (1 - alpha) d + alpha z, the slope's factor."""
    d = hypot(x, z)
    x2, z2, excess = np.square(x), np.square(z), 2.0 * alpha - 1.0
    is_below = z < 0.0

    def add(along: float, excess: float) -> Floats:
        across = 1.0 - along
        # One form for each hemisphere, so that no terms of opposite sign are added.
        divisor = np.where(is_below, along * d - across * z, 1.0)
        quotient = (along * along * x2 + excess * z2) / divisor
        return np.where(is_below, quotient, along * d + across * z)

    return add(alpha, excess), d, add(1.0 - alpha, -excess)


def unproject_sphere(ratio: Floats, alpha: float) -> tuple[Floats, Floats, Bools]:
    """Point (x, z) before the pinhole, of any length, of a radius x / (alpha d + (1 - alpha) z).

    Finite for every finite radius; the axis where no point has the radius.
    """
    excess = 2.0 * alpha - 1.0
    scaled = math.sqrt(abs(excess)) * ratio
    inside = (ratio < math.inf) & ((scaled <= 1.0) | (excess <= 0.0))
    ratio, scaled = np.where(inside, ratio, 0.0), np.where(inside, scaled, 0.0)
    folding = np.sqrt((1.0 - np.minimum(scaled, 1.0)) * (1.0 + scaled))
    root = folding if excess > 0.0 else hypot(1.0, scaled)
    # Divided by the radius where its square may overflow.
    size = np.maximum(ratio, 1.0)
    x = ratio / size * (alpha * root + (1.0 - alpha))
    return x, (1.0 - alpha * ratio) / size * (1.0 + alpha * ratio), inside
