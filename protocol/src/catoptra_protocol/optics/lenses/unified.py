"""Unified lens of Mei: a sphere, a pinhole xi behind its centre, and radial distortion.

On the plane m = sin(theta) / (xi + cos(theta)), distorted to r = m (1 + k1 m^2 + k2 m^4). Source:
Mei & Rives, ICRA 2007; cv2.omnidir, Kalibr's "omni", CamOdoCal's "MEI", BoofCV's universal model.
Tangential distortion and skew belong to `ImagePlane`. Domain: cos(theta) > -xi for xi <= 1 and
cos(theta) > -1 / xi above, or to the first fold of the distortion. A hyperbolic mirror is the
unified lens of xi = s / (k - 1) without distortion.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.curves import first_root, solve_increasing, tabulate
from catoptra_protocol.optics.elementary import arctan, hypot, tan
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats, has_finite_square, require_domain
from catoptra_protocol.optics.radial_camera import NO_FOLD
from catoptra_protocol.slotted_dataclass import dataclass

# Radii without limit: tangents to 1.6e16, then decades, as far as their powers are finite.
_NUM_STARTS = 1025
_FAR = np.array([float(f"1e{power}") for power in range(17, 301)])


@dataclass(frozen=True, slots=True)
class UnifiedLens(CentredLens):
    """Lens by the sphere parameter and two coefficients of radial distortion."""

    xi: float
    """Distance of the pinhole from the sphere's centre, in radii, >= 0."""
    k1: float = 0.0
    k2: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.xi) and self.xi >= 0.0):
            raise DomainError(f"a unified lens needs xi >= 0, not {self.xi!r}")
        if not (math.isfinite(self.k1) and math.isfinite(self.k2)):
            raise DomainError(f"k1 and k2 must be finite: {self.k1!r}, {self.k2!r}")

    @property
    def formula_t_limit(self) -> float:
        """Half-angle tangent at which the sphere's formula ends, whatever its distortion."""
        ratio = abs(1.0 - self.xi)
        return math.inf if ratio == 0.0 else math.sqrt((1.0 + self.xi) / ratio)

    @property
    def fold_rad(self) -> float:
        """Angle at which the distorted radius turns back; inf if it does not."""
        return _fold_rad(self)

    @property
    def t_limit(self) -> float:
        """Half-angle tangent of the formula's limit or of the first fold."""
        fold_rad = self.fold_rad
        limit = tan(0.5 * math.pi) if math.isinf(self.formula_t_limit) else self.formula_t_limit
        return limit if math.isinf(fold_rad) else tan(0.5 * fold_rad)

    def undistorted_ratio_from_t(self, t: Floats) -> Floats:
        """Radius m before the distortion: 2 t / ((1 + xi) + (xi - 1) t^2).

        Domain: 0 <= t <= limit; inf at the limit for xi < 1.
        """
        inside = (t >= 0.0) & has_finite_square(t)
        require_domain(inside, t, "an image radius needs t = tan(theta / 2) >= 0")
        require_angle(t, self.formula_t_limit)
        denominator = (1.0 + self.xi) + (self.xi - 1.0) * np.square(t)
        # At the limit of xi < 1 rounding alone decides the sign.
        grows = denominator > 0.0
        return np.where(grows, 2.0 * t / np.where(grows, denominator, 1.0), math.inf)

    def t_from_undistorted_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of a radius m; inf where none has it. Domain: ratio >= 0."""
        require_radius(ratio)
        # sqrt(1 - (xi^2 - 1) m^2), of radii whose square may overflow.
        scaled = math.sqrt(abs(self.xi - 1.0)) * math.sqrt(self.xi + 1.0) * ratio
        if self.xi > 1.0:
            inside = scaled <= 1.0
            within = np.where(inside, scaled, 1.0)
            root = np.sqrt((1.0 - within) * (1.0 + within))
        else:
            inside, root = ratio < math.inf, hypot(1.0, scaled)
        t = np.where(inside, ratio, 0.0) / (1.0 + root) * (1.0 + self.xi)
        return np.where(inside, t, math.inf)

    def distortion_factor(self, squared_ratio: Floats) -> tuple[Floats, Floats]:
        """1 + k1 q + k2 q^2 at q = m^2, and the derivative by q."""
        factor = 1.0 + squared_ratio * (self.k1 + squared_ratio * self.k2)
        return factor, self.k1 + 2.0 * self.k2 * squared_ratio

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / gamma = m (1 + k1 m^2 + k2 m^4). Domain: 0 <= t < limit."""
        require_angle(t, self.t_limit)
        return self._distort(self.undistorted_ratio_from_t(t))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of r / gamma, inf beyond the last. Domain: ratio >= 0."""
        if self.k1 == 0.0 and self.k2 == 0.0:
            return self.t_from_undistorted_ratio(ratio)
        require_radius(ratio)
        table = _table(self)
        m = solve_increasing(self._distort, self._distortion_slope, ratio, table)
        t = np.minimum(self.t_from_undistorted_ratio(m), self.t_limit)
        return np.where(ratio > table[1][-1], math.inf, t)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / gamma) / d(theta). Domain: 0 <= t < limit, with a finite square."""
        require_angle(t, self.t_limit)
        m = self.undistorted_ratio_from_t(t)
        return self.undistorted_slope(t) * self._distortion_slope(m)

    def undistorted_slope(self, t: Floats) -> Floats:
        """Derivative dm / d(theta) = (1 + xi cos) / (xi + cos)^2. Domain: that of the slope."""
        squared = np.square(t)
        numerator = ((1.0 + self.xi) + (1.0 - self.xi) * squared) * (1.0 + squared)
        denominator: Floats = (1.0 + self.xi) + (self.xi - 1.0) * squared
        return numerator / np.square(denominator)

    def _distort(self, m: Floats) -> Floats:
        """Radius of an undistorted one, inf of inf."""
        if self.k1 == 0.0 and self.k2 == 0.0:
            return m
        return m * self.distortion_factor(np.square(m))[0]

    def _distortion_slope(self, m: Floats) -> Floats:
        """Its derivative."""
        q = np.square(m)
        slope: Floats = 1.0 + q * (3.0 * self.k1 + 5.0 * self.k2 * q)
        return slope


@lru_cache(maxsize=64)
def _fold_rad(lens: UnifiedLens) -> float:
    # dr / dm = 1 + 3 k1 q + 5 k2 q^2 with q = m^2.
    root = first_root(np.array((1.0, 3.0 * lens.k1, 5.0 * lens.k2)), low=0.0, high=math.inf)
    if math.isinf(root):
        return NO_FOLD
    t = float(lens.t_from_undistorted_ratio(np.array(math.sqrt(root))))
    return NO_FOLD if math.isinf(t) else 2.0 * arctan(t)


@lru_cache(maxsize=64)
def _table(lens: UnifiedLens) -> tuple[Floats, Floats]:
    """Undistorted and distorted radii."""
    if lens.xi > 1.0 or not math.isinf(lens.fold_rad):
        return tabulate(
            lens._distort, 0.0, float(lens.undistorted_ratio_from_t(np.array(lens.t_limit)))
        )
    m = np.append(tan(np.linspace(0.0, 0.5 * math.pi, _NUM_STARTS)), _FAR)
    with np.errstate(over="ignore", invalid="ignore"):
        values = lens._distort(m)
    is_finite = np.isfinite(values)
    return m[is_finite], values[is_finite]
