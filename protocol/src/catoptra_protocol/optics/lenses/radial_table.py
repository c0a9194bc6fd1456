"""Measured lens: image radii at angles from the axis, with a cubic spline between.

The radius is an odd function of the angle, so the spline is smooth to second order through the
axis. Domain: to the last angle; a table whose spline turns back anywhere is rejected.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.curves import (
    CubicSpline,
    Symmetry,
    check_column,
    fit_spline,
    solve_increasing,
)
from catoptra_protocol.optics.elementary import arctan, tan
from catoptra_protocol.optics.lenses.angle_polynomial import half_angle_from_theta
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass

# A last knot of 180 degrees in decimal digits may be above pi by a rounding.
_ANTIPODE_DEG = 180.0


@dataclass(frozen=True, slots=True)
class RadialTableLens(CentredLens):
    """Lens by a table of angles and image radii."""

    angles_deg: tuple[float, ...]
    """Increasing angles from the axis, the first 0, the last at most 180."""
    radii: tuple[float, ...]
    """Increasing image radii in the unit of the scale (pixels for a scale of 1), the first 0."""

    def __post_init__(self) -> None:
        check_column("angles", self.angles_deg)
        check_column("radii", self.radii)
        if len(self.angles_deg) != len(self.radii):
            raise DomainError(
                f"a table of {len(self.angles_deg)} angles needs as many radii, not "
                f"{len(self.radii)}"
            )
        if self.angles_deg[-1] > _ANTIPODE_DEG:
            raise DomainError(f"an angle from the axis ends at 180 deg: {self.angles_deg[-1]!r}")
        if _spline(self).smallest_slope() <= 0.0:
            raise DomainError(
                "the smooth curve through the table turns back: more knots, or radii without noise"
            )

    @property
    def t_limit(self) -> float:
        """Half-angle tangent just behind the last angle."""
        last = self.angles_deg[-1]
        if last >= _ANTIPODE_DEG:
            return math.inf
        return tan(0.5 * math.radians(last)) * (1.0 + 1e-12)

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Image radius in the scale's unit. Domain: 0 <= t < t_limit."""
        require_angle(t, self.t_limit)
        return _spline(self).evaluate(2.0 * arctan(t))[0]

    @np.errstate(under="ignore")
    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of an image radius, inf beyond the last. Domain: ratio >= 0."""
        require_radius(ratio)
        spline = _spline(self)
        theta = solve_increasing(
            lambda x: spline.evaluate(x)[0],
            lambda x: spline.evaluate(x)[1],
            ratio,
            (spline.knots, spline.values),
        )
        return np.where(ratio > self.radii[-1], math.inf, half_angle_from_theta(theta))

    @np.errstate(under="ignore")
    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Scale's units per radian. Domain: 0 <= t < t_limit."""
        require_angle(t, self.t_limit)
        return _spline(self).evaluate(2.0 * arctan(t))[1]


@lru_cache(maxsize=64)
def _spline(lens: RadialTableLens) -> CubicSpline:
    angles = np.minimum(np.radians(lens.angles_deg), math.pi)
    return fit_spline(angles, np.array(lens.radii), Symmetry.ODD)
