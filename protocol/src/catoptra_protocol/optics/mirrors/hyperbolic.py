"""The hyperbolic mirror in front of a pinhole camera: the paper's.

Surface: Schmits & Visser 2009, Eq. 1 (Baker & Nayar 1999), the sheet around the effective
viewpoint: (z - c/2)^2 - r^2 (k/2 - 1) = (c^2/4)(k - 2)/k, foci at the viewpoint (0, 0) and the
pinhole (0, c). Image: with t = tan(theta/2) and psi the camera ray's angle, tan(psi/2) = kappa
tan(theta/2), from which r_i / h = 2 kappa s t / (1 - kappa^2 t^2). This is the mirror's own law;
the paper's Eq. 2 (r_i = h t) is its limit for k -> infinity, kept here as `eq2_radius_ratio_from_t`
for comparison.

From the plane that k = 2 would be to the largest double no form cancels or overflows: 1 - kappa is
a quotient of sums, and 1 - kappa t and 1 - kappa t^2 are made of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.domain_checks import has_finite_square, require_domain
from catoptra_protocol.optics.numerics import Floats


def eq2_radius_ratio_from_t(t: Floats) -> Floats:
    """Return r_i / h of the paper's Eq. 2, sin(theta) / (1 + cos(theta)), which is t itself."""
    return t


@dataclass(frozen=True, slots=True)
class HyperbolicMirror:
    """Eq. 1 with its constants k > 2 and c > 0 (metres): c is the viewpoint-to-pinhole distance."""

    k: float
    c_m: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.k) and self.k > 2.0):
            raise DomainError(f"a hyperbolic mirror needs k > 2 (k = 2 is a plane), not {self.k!r}")
        if not (math.isfinite(self.c_m) and self.c_m > 0.0):
            raise DomainError(
                f"a hyperbolic mirror needs c > 0, not {self.c_m!r}: c < 0 is concave"
            )

    @property
    def s(self) -> float:
        """Return sqrt(k (k - 2)) = f / h, focal length over 90-degree circle."""
        return math.sqrt(self.k) * math.sqrt(self.k - 2.0)

    @property
    def kappa(self) -> float:
        """Return tan(psi/2) / tan(theta/2) = 1 / (k - 1 + s)."""
        return 0.5 / self._half_sum

    @property
    def one_minus_kappa(self) -> float:
        """Return 1 - kappa = (k - 2 + s) / (k - 1 + s), which does not cancel near k = 2."""
        return (0.5 * (self.k - 2.0) + 0.5 * self.s) / self._half_sum

    @property
    def kappa_s(self) -> float:
        """Return kappa s = xi / (1 + xi): kappa may be next to nothing, this never is."""
        return self.xi / (1.0 + self.xi)

    @property
    def _half_sum(self) -> float:
        """Return (k - 1 + s) / 2: the sum itself overflows for the largest k."""
        return 0.5 * (self.k - 1.0) + 0.5 * self.s

    @property
    def xi(self) -> float:
        """Return the unified (Mei) model's sphere parameter s / (k - 1)."""
        return self.s / (self.k - 1.0)

    @property
    def vertex_height_m(self) -> float:
        """Return the height of the mirror's vertex over the viewpoint, towards the pinhole."""
        return 0.5 * self.c_m / (0.5 * self.k + 0.5 * self.s)

    @property
    def t_limit(self) -> float:
        """Return t of the asymptote, 1 / sqrt(kappa)."""
        return math.sqrt(2.0) * math.sqrt(self._half_sum)

    @property
    def pinhole_distance_m(self) -> float:
        """Return c: the pinhole is the second focus."""
        return self.c_m

    @np.errstate(under="ignore")  # what vanishes beside 1 may
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Return r_i / h. Domain: 0 <= t < 1/kappa (the mirror itself ends at t_limit before)."""
        return 2.0 * self.kappa_s * t / (self._one_minus_kappa_t(t) * (1.0 + self.kappa * t))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Return t. Domain: 0 <= ratio < inf; hypot keeps it finite for any of them."""
        require_domain((ratio >= 0.0) & (ratio < math.inf), ratio, "an image radius is 0 or more")
        return ratio / (self.kappa_s + np.hypot(self.kappa_s, self.kappa * ratio))

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Return d(r_i / h) / d(theta) = kappa s (1 + k^2 t^2) (1 + t^2) / (1 - k^2 t^2)^2.

        Domain: that of radius_ratio_from_t, with a finite square of t.
        """
        require_domain(
            has_finite_square(t), t, "a slope needs 0 <= t = tan(theta / 2) with a finite square"
        )
        kt = self.kappa * t
        steepness = (1.0 + np.square(kt)) / np.square(self._one_minus_kappa_t(t) * (1.0 + kt))
        return self.kappa_s * (1.0 + np.square(t)) * steepness

    @np.errstate(under="ignore")
    def surface_point(self, t: Floats) -> tuple[Floats, Floats]:
        """Return (r, z) in metres of the mirror point. Domain: 0 <= t < t_limit."""
        expected = f"a mirror point needs 0 <= t = tan(theta / 2) < {self.t_limit!r}, its asymptote"
        require_domain((t >= 0.0) & (t < self.t_limit) & has_finite_square(t), t, expected)
        nearness = (1.0 - t) * (1.0 + t)
        scale = self.vertex_height_m / (self.one_minus_kappa + self.kappa * nearness)
        return 2.0 * scale * t, scale * nearness

    def _one_minus_kappa_t(self, t: Floats) -> Floats:
        """Return 1 - kappa t, exact where both are next to 1; DomainError where nothing is left."""
        left: Floats = self.one_minus_kappa + self.kappa * (1.0 - t)
        inside = (t >= 0.0) & (left > 0.0)
        require_domain(inside, t, "an image radius needs 0 <= t = tan(theta / 2) < 1 / kappa")
        return left


# The paper prints c = 2.321 without a unit; 0.1 m a unit makes a mirror of 85 mm, as in the robot
# files (MetresPerUnit).
PAPER_MIRROR = HyperbolicMirror(k=11.546, c_m=0.2321)
"""Mirror of the paper, by the constants of Eq. 1. Source: Schmits & Visser 2009."""
