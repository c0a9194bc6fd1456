"""Hyperbolic mirror with a pinhole camera, as in the paper.

Surface: Schmits & Visser 2009, Eq. 1 (Baker & Nayar 1999), the sheet around the effective
viewpoint: (z - c/2)^2 - r^2 (k/2 - 1) = (c^2/4)(k - 2)/k, foci at the viewpoint (0, 0) and the
pinhole (0, c).

Image: with t = tan(theta/2) and psi the angle of the camera ray, tan(psi/2) = kappa tan(theta/2),
hence r_i / h = 2 kappa s t / (1 - kappa^2 t^2). This is the exact projection; the paper's Eq. 2
(r_i = h t) is the limit for k -> infinity, kept as `eq2_radius_ratio_from_t` for comparison.

No form cancels or overflows between the plane (k = 2) and the largest float: 1 - kappa is a
quotient of sums, from which 1 - kappa t and 1 - kappa t^2 are composed.

One identity carries the projection and its inverse from the axis to the asymptote, and the horizon
is t = 1 exactly. The model holds to a dozen roundings from k next to 2 up to the largest double.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.mirrors.mirror import CentralMirror
from catoptra_protocol.optics.numerics import Floats, has_finite_square, require_domain
from catoptra_protocol.slotted_dataclass import dataclass


def eq2_radius_ratio_from_t(t: Floats) -> Floats:
    """Ratio r_i / h by the paper's Eq. 2: sin(theta) / (1 + cos(theta)), which equals t."""
    return t


@dataclass(frozen=True, slots=True)
class HyperbolicMirror(CentralMirror):
    """Hyperbolic mirror by the constants of Eq. 1."""

    k: float
    """Shape constant, > 2; k = 2 is a plane."""
    c_m: float
    """Distance from the viewpoint to the pinhole, in metres, > 0."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.k) and self.k > 2.0):
            raise DomainError(f"a hyperbolic mirror needs k > 2 (k = 2 is a plane), not {self.k!r}")
        if not (math.isfinite(self.c_m) and self.c_m > 0.0):
            raise DomainError(
                f"a hyperbolic mirror needs c > 0, not {self.c_m!r}: c < 0 is concave"
            )

    @property
    def s(self) -> float:
        """Focal length over the 90-degree circle, f / h = sqrt(k (k - 2))."""
        # Two roots, because the product k (k - 2) overflows for large k.
        return math.sqrt(self.k) * math.sqrt(self.k - 2.0)

    @property
    def kappa(self) -> float:
        """Ratio tan(psi/2) / tan(theta/2) = 1 / (k - 1 + s)."""
        return 0.5 / self._half_sum

    @property
    def one_minus_kappa(self) -> float:
        """1 - kappa = (k - 2 + s) / (k - 1 + s), without cancellation near k = 2."""
        return (0.5 * (self.k - 2.0) + 0.5 * self.s) / self._half_sum

    @property
    def kappa_s(self) -> float:
        """Product kappa s = xi / (1 + xi), which stays regular where kappa underflows."""
        return self.xi / (1.0 + self.xi)

    @property
    def _half_sum(self) -> float:
        """(k - 1 + s) / 2, halved because the sum overflows for the largest k."""
        return 0.5 * (self.k - 1.0) + 0.5 * self.s

    @property
    def xi(self) -> float:
        """Sphere parameter of the unified (Mei) model, s / (k - 1)."""
        return self.s / (self.k - 1.0)

    @property
    def vertex_height_m(self) -> float:
        """Distance from the viewpoint to the vertex of the mirror, towards the pinhole."""
        return 0.5 * self.c_m / (0.5 * self.k + 0.5 * self.s)

    @property
    def t_limit(self) -> float:
        """Half-angle tangent of the asymptote, 1 / sqrt(kappa)."""
        return math.sqrt(2.0) * math.sqrt(self._half_sum)

    @property
    def pinhole_distance_m(self) -> float:
        """Distance c: the pinhole is the second focus."""
        return self.c_m

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r_i / h = 2 kappa s t / (1 - kappa^2 t^2).

        Domain: 0 <= t < 1/kappa; the mirror itself ends earlier, at t_limit.
        """
        return 2.0 * self.kappa_s * t / (self._one_minus_kappa_t(t) * (1.0 + self.kappa * t))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of r_i / h. Domain: 0 <= ratio < inf."""
        require_domain((ratio >= 0.0) & (ratio < math.inf), ratio, "an image radius is 0 or more")
        # Root of the quadratic in t with the signs that add; hypot is finite for any ratio.
        return ratio / (self.kappa_s + hypot(self.kappa_s, self.kappa * ratio))

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r_i / h) / d(theta).

        With q = kappa^2: kappa s (1 + q t^2) (1 + t^2) / (1 - q t^2)^2. Domain: that of
        `radius_ratio_from_t`, with a finite square of t.
        """
        require_domain(
            has_finite_square(t), t, "a slope needs 0 <= t = tan(theta / 2) with a finite square"
        )
        kt = self.kappa * t
        steepness = (1.0 + np.square(kt)) / np.square(self._one_minus_kappa_t(t) * (1.0 + kt))
        return self.kappa_s * (1.0 + np.square(t)) * steepness

    @np.errstate(under="ignore")
    def surface_point(self, t: Floats) -> tuple[Floats, Floats]:
        """Mirror point (r, z) in metres. Domain: 0 <= t < t_limit."""
        expected = f"a mirror point needs 0 <= t = tan(theta / 2) < {self.t_limit!r}, its asymptote"
        require_domain((t >= 0.0) & (t < self.t_limit) & has_finite_square(t), t, expected)
        # (1 - t)(1 + t) keeps the sign of z exact at the horizon, where 1 - t^2 rounds.
        cosine_term = (1.0 - t) * (1.0 + t)
        # 1 - kappa t^2 = (1 - kappa) + kappa (1 - t^2): a sum instead of a difference.
        scale = self.vertex_height_m / (self.one_minus_kappa + self.kappa * cosine_term)
        return 2.0 * scale * t, scale * cosine_term

    def _one_minus_kappa_t(self, t: Floats) -> Floats:
        """1 - kappa t, exact where kappa and t are both close to 1; DomainError where it is not
        positive.
        """
        remainder: Floats = self.one_minus_kappa + self.kappa * (1.0 - t)
        inside = (t >= 0.0) & (remainder > 0.0)
        require_domain(inside, t, "an image radius needs 0 <= t = tan(theta / 2) < 1 / kappa")
        return remainder


# The paper prints c = 2.321 without a unit; 0.1 m a unit makes a mirror of 85 mm, as in the robot
# files (MetresPerUnit).
PAPER_MIRROR = HyperbolicMirror(k=11.546, c_m=0.2321)
"""Mirror of the paper, by the constants of Eq. 1. Source: Schmits & Visser 2009."""
