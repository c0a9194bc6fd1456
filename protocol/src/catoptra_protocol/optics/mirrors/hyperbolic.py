"""The hyperbolic mirror in front of a pinhole camera: the paper's.

Surface: Schmits & Visser 2009, Eq. 1 (Baker & Nayar 1999), the sheet around the effective
viewpoint: (z - c/2)^2 - r^2 (k/2 - 1) = (c^2/4)(k - 2)/k, foci at the viewpoint (0, 0) and the
pinhole (0, c). Image: with t = tan(theta/2) and psi the camera ray's angle, tan(psi/2) = kappa
tan(theta/2), from which r_i / h = 2 kappa s t / (1 - kappa^2 t^2). This is the mirror's own law;
the paper's Eq. 2 (r_i = h t) is its limit for k -> infinity, kept here as `eq2_radius_ratio_from_t`
for comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
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
        return 1.0 / (self.k - 1.0 + self.s)

    @property
    def xi(self) -> float:
        """Return the unified (Mei) model's sphere parameter s / (k - 1)."""
        return self.s / (self.k - 1.0)

    @property
    def vertex_m(self) -> float:
        """Return the height of the mirror's vertex over the viewpoint, towards the pinhole."""
        return self.c_m / (self.k + self.s)

    @property
    def t_limit(self) -> float:
        """Return t of the asymptote, 1 / sqrt(kappa)."""
        return 1.0 / math.sqrt(self.kappa)

    @property
    def pinhole_m(self) -> float:
        """Return c: the pinhole is the second focus."""
        return self.c_m

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Return r_i / h. Domain: 0 <= t < 1/kappa (the mirror itself ends at t_limit before)."""
        kt = self.kappa * t
        return 2.0 * self.s * kt / ((1.0 - kt) * (1.0 + kt))

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Return t. Domain: ratio >= 0; hypot keeps it finite for any of them."""
        return ratio / (self.kappa * (self.s + np.hypot(self.s, ratio)))

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Return d(r_i / h) / d(theta) = kappa s (1 + k^2 t^2) (1 + t^2) / (1 - k^2 t^2)^2."""
        kt2 = np.square(self.kappa * t)
        return self.kappa * self.s * (1.0 + kt2) * (1.0 + np.square(t)) / np.square(1.0 - kt2)

    def surface(self, t: Floats) -> tuple[Floats, Floats]:
        """Return (r, z) in metres of the mirror point. Domain: 0 <= t < t_limit."""
        denominator = 1.0 - self.kappa * np.square(t)
        r = 2.0 * self.vertex_m * t / denominator
        z = self.vertex_m * (1.0 - t) * (1.0 + t) / denominator
        return r, z
