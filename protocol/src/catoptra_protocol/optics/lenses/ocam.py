"""OCamCalib's lens: the ray of an image radius rho is (rho, a0 + a2 rho^2 + a3 rho^3 + ...).

Source: Scaramuzza, Martinelli & Siegwart, IROS 2006, with the axis towards the scene, so a0 > 0
(OCamCalib's files have the other sign). rho is in pixels of the calibrated image, so the scale is 1
at that size; its affine matrix is the image plane's stretch. Domain: to the first fold, where the
angle stops growing with the radius.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.curves import first_root, solve_increasing, tabulate
from catoptra_protocol.optics.elementary import arctan, arctan2, tan
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats, half_angle_tangent_from_rho_z
from catoptra_protocol.optics.radial_camera import NO_FOLD
from catoptra_protocol.slotted_dataclass import dataclass

# A polynomial without a fold ends here: images reach a few times a0.
_MAX_RADIUS = 32.0


@dataclass(frozen=True, slots=True)
class OCamLens(CentredLens):
    """Lens by the height of its rays as a polynomial of the image radius."""

    polynomial: tuple[float, ...]
    """a0 > 0 (pixels), a1 (mostly 0), a2, ...: of rho^0, rho^1, rho^2, ..."""

    def __post_init__(self) -> None:
        if not self.polynomial or not all(map(math.isfinite, self.polynomial)):
            raise DomainError(f"OCam's polynomial needs finite terms: {self.polynomial!r}")
        if self.polynomial[0] <= 0.0:
            raise DomainError(
                "OCam's a0 must be above 0, with the axis towards the scene: "
                f"{self.polynomial[0]!r}"
            )

    @property
    def fold_rad(self) -> float:
        """Angle that no radius exceeds; inf where the table ends before."""
        radius, is_fold = _last_radius(self)
        return float(self._theta(np.array(radius))) if is_fold else NO_FOLD

    @property
    def t_limit(self) -> float:
        """Half-angle tangent of the last radius."""
        return tan(0.5 * float(self._theta(np.array(_last_radius(self)[0]))))

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Radius in calibrated pixels. Domain: 0 <= t <= t_limit."""
        require_angle(t, self.t_limit)
        return solve_increasing(self._theta, self._theta_slope, 2.0 * arctan(t), _table(self))

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of a radius, inf beyond the last. Domain: ratio >= 0."""
        require_radius(ratio)
        last, _ = _last_radius(self)
        within = np.minimum(ratio, last)
        t, defined = half_angle_tangent_from_rho_z(within, self._height(within))
        return np.where((ratio <= last) & defined, t, math.inf)

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Calibrated pixels per radian. Domain: 0 <= t < t_limit."""
        slope: Floats = 1.0 / self._theta_slope(self.radius_ratio_from_t(t))
        return slope

    def _height(self, radius: Floats) -> Floats:
        return np.asarray(np.polynomial.polynomial.polyval(radius, self.polynomial))

    def _theta(self, radius: Floats) -> Floats:
        return np.asarray(arctan2(radius, self._height(radius)))

    def _theta_slope(self, radius: Floats) -> Floats:
        """d(theta) / d(rho) = (f - rho f') / (rho^2 + f^2)."""
        height = self._height(radius)
        numerator = np.polynomial.polynomial.polyval(radius, _fold_terms(self))
        return np.asarray(numerator / (np.square(radius) + np.square(height)))


def _fold_terms(lens: OCamLens) -> Floats:
    """Coefficients of f - rho f'."""
    return np.array([(1.0 - power) * a for power, a in enumerate(lens.polynomial)])


@lru_cache(maxsize=64)
def _last_radius(lens: OCamLens) -> tuple[float, bool]:
    """Radius of the first fold, or of the end of the table."""
    end = _MAX_RADIUS * lens.polynomial[0]
    fold = first_root(_fold_terms(lens), low=0.0, high=end)
    return (fold, True) if fold < end else (end, False)


@lru_cache(maxsize=64)
def _table(lens: OCamLens) -> tuple[Floats, Floats]:
    return tabulate(lens._theta, 0.0, _last_radius(lens)[0])
