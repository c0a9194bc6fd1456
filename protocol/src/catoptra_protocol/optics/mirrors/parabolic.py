"""Parabolic mirror with an orthographic camera, for which the paper's Eq. 2 is exact.

Surface: z = (p^2 - r^2) / (2 p) with p the mirror radius at the horizon; image: r_i = h tan(theta /
2). Source: Nayar, CVPR 1997; Schmits & Visser 2009, Eq. 2.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors.mirror import CentralMirror
from catoptra_protocol.optics.numerics import Floats, has_finite_square, require_domain
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class ParabolicMirror(CentralMirror):
    """Paraboloid, described by its radius at the horizon."""

    horizon_radius_m: float
    """Radius of the mirror at the 90-degree circle, in metres, > 0."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.horizon_radius_m) and self.horizon_radius_m > 0.0):
            raise DomainError(
                f"a parabolic mirror needs a radius > 0, not {self.horizon_radius_m!r}"
            )

    @property
    def t_limit(self) -> float:
        """Infinity: every direction but the antipode is reflected."""
        return math.inf

    @property
    def pinhole_distance_m(self) -> float:
        """Infinity: the camera is orthographic."""
        return math.inf

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r_i / h = t. Domain: 0 <= t < inf."""
        expected = "an image radius needs a finite t = tan(theta / 2) >= 0"
        require_domain((t >= 0.0) & (t < math.inf), t, expected)
        return t

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent t = r_i / h. Domain: 0 <= ratio < inf."""
        require_domain((ratio >= 0.0) & (ratio < math.inf), ratio, "an image radius is 0 or more")
        return ratio

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r_i / h) / d(theta) = (1 + t^2) / 2. Domain: t >= 0 with a finite square."""
        require_domain(
            (t >= 0.0) & has_finite_square(t), t, "a slope needs t >= 0 with a finite square"
        )
        return 0.5 * (1.0 + np.square(t))

    @np.errstate(under="ignore")
    def surface_point(self, t: Floats) -> tuple[Floats, Floats]:
        """Mirror point (r, z) in metres. Domain: t >= 0 with a finite square."""
        require_domain(
            (t >= 0.0) & has_finite_square(t), t, "a mirror point needs t >= 0 with a finite square"
        )
        # As a product z changes sign exactly at t = 1; p^2 - r^2 would cancel there.
        return self.horizon_radius_m * t, 0.5 * self.horizon_radius_m * (1.0 - t) * (1.0 + t)
