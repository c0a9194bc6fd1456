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
    CentredLens,
    require_angle,
    require_radius,
)
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
        low, high = sorted((self.alpha, 1.0 - self.alpha))
        w1 = low / high
        # (xi + z)^2 = w1^2 (1 + xi^2 + 2 xi z), its solution with xi + z < 0. For xi > 1 none.
        rest = (1.0 - w1) * (1.0 + w1) * self.xi
        square = 1.0 - rest * self.xi
        lowest = -rest - w1 * math.sqrt(square) if self.xi <= 1.0 else -1.0 / self.xi
        if lowest <= -1.0:
            return tan(0.5 * math.pi)
        return math.sqrt((1.0 - lowest) / (1.0 + lowest))

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f. Domain: 0 <= t < t_limit."""
        sine, _, _, denominator = self._terms(t)
        return sine / denominator

    @np.errstate(over="ignore", under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of r / f, inf where no angle has it. Domain: ratio >= 0."""
        require_radius(ratio)
        squared = np.square(ratio)
        root = 1.0 - (2.0 * self.alpha - 1.0) * squared
        inside = (root >= 0.0) & np.isfinite(squared)
        root, squared = np.where(inside, root, 1.0), np.where(inside, squared, 0.0)
        z = (1.0 - self.alpha * self.alpha * squared) / (
            self.alpha * np.sqrt(root) + (1.0 - self.alpha)
        )
        sphere = np.square(z) + (1.0 - self.xi * self.xi) * squared
        inside &= sphere >= 0.0
        length = z * self.xi + np.sqrt(np.where(inside, sphere, 0.0))
        length = length / (np.square(z) + squared)
        rho = np.where(inside, length * ratio, 0.0)
        t, defined = half_angle_tangent_from_rho_z(rho, np.where(inside, length * z - self.xi, 1.0))
        return np.where(inside & defined & (t <= self.t_limit), t, math.inf)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta). Domain: 0 <= t < t_limit."""
        _, cosine, d2, denominator = self._terms(t)
        # (1 + xi cos) ((1 - alpha) + alpha (xi + cos) / d2) / D^2
        second = (1.0 - self.alpha) + self.alpha * (self.xi + cosine) / d2
        return (1.0 + self.xi * cosine) * second / np.square(denominator)

    def _terms(self, t: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """sin, cos, d2 and the denominator."""
        require_angle(t, self.t_limit)
        squared = np.square(t)
        sine, cosine = 2.0 * t / (1.0 + squared), (1.0 - t) * (1.0 + t) / (1.0 + squared)
        d2 = hypot(sine, self.xi + cosine)
        return sine, cosine, d2, self.alpha * d2 + (1.0 - self.alpha) * (self.xi + cosine)
