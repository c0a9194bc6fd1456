"""Unified and enhanced unified lens: m = rho / (alpha d + (1 - alpha) z), d^2 = beta rho^2 + z^2.

Source: Khomutenko et al., RA-L 2016 (EUCM); beta = 1 is the unified model in Basalt's form (UCM),
the sphere of xi = alpha / (1 - alpha). The focal length is the scale. Domain: z > -w d with w =
alpha / (1 - alpha), or its inverse for alpha > 1/2, where the image radius turns back.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import hypot, tan
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_radius,
)
from catoptra_protocol.optics.numerics import (
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
        low, high = sorted((self.alpha, 1.0 - self.alpha))
        w = low / high
        # tan^2(theta) = (1 - w^2) / (beta w^2), theta above 90 degrees.
        sine, cosine = math.sqrt((1.0 - w) * (1.0 + w)), -math.sqrt(self.beta) * w
        norm = hypot(sine, cosine)
        return (norm - cosine) / sine if sine > 0.0 else tan(0.5 * math.pi)

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f. Domain: 0 <= t < t_limit."""
        return 2.0 * t / self._denominator(t)[0]

    @np.errstate(over="ignore", under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of r / f, inf where no angle has it. Domain: ratio >= 0."""
        require_radius(ratio)
        squared = self.beta * np.square(ratio)
        root = 1.0 - (2.0 * self.alpha - 1.0) * squared
        inside = (root >= 0.0) & np.isfinite(squared)
        root, squared = np.where(inside, root, 1.0), np.where(inside, squared, 0.0)
        z = (1.0 - self.alpha * self.alpha * squared) / (
            self.alpha * np.sqrt(root) + (1.0 - self.alpha)
        )
        t, defined = half_angle_tangent_from_rho_z(np.where(inside, ratio, 0.0), z)
        return np.where(inside & defined, t, math.inf)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta). Domain: 0 <= t < t_limit, with a finite square."""
        # ((1 - alpha) + alpha cos / d) / D^2, all of a unit direction.
        denominator, d = self._denominator(t)
        z = (1.0 - t) * (1.0 + t)
        square = np.square((1.0 + np.square(t)) / denominator)
        return ((1.0 - self.alpha) + self.alpha * z / d) * square

    def _denominator(self, t: Floats) -> tuple[Floats, Floats]:
        """alpha d + (1 - alpha) z and d, times 1 + t^2."""
        inside = (t >= 0.0) & (t <= self.t_limit) & has_finite_square(t)
        require_domain(inside, t, "an image radius needs 0 <= t = tan(theta / 2) within the limit")
        z = (1.0 - t) * (1.0 + t)
        d = hypot(2.0 * math.sqrt(self.beta) * t, z)
        return self.alpha * d + (1.0 - self.alpha) * z, d
