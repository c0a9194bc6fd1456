"""Measured mirror: image radii at angles of the scene, under a pinhole camera.

A calibration with marks at known angles gives such a table. Between its knots the image radius
tan(psi) is the cubic spline m(theta), odd in theta. The surface follows from the law of reflection:
about the pinhole it is D(psi) with d(ln D) / d(psi) = tan((theta + psi) / 2), from the vertex at
D0. In general not central. Domain: to the last angle; a table whose spline turns back, or whose
mirror would be concave, is rejected. Source of the surface: Chahl & Srinivasan, Applied Optics 36
(1997), for any theta(psi).
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
    gauss_legendre,
    solve_increasing,
)
from catoptra_protocol.optics.elementary import arctan, cos, exp, matmul, sin, tan
from catoptra_protocol.optics.mirrors.non_central import (
    NonCentralMirror,
    Reflection,
    check_rim,
    check_vertex_distance,
)
from catoptra_protocol.optics.numerics import Floats, require_domain
from catoptra_protocol.slotted_dataclass import dataclass

# Intervals of the surface's table at least: with slopes at both ends its error falls with the
# fourth power, and is 1e-12 of the distance with so many.
_MIN_INTERVALS = 4096
# Nodes of Gauss and Legendre's rule in an interval: exact to a rounding.
_NODES, _WEIGHTS = gauss_legendre(4)
_SLACK = 1e-12


@dataclass(frozen=True, slots=True)
class RadialTableMirror(NonCentralMirror):
    """Mirror by a table of angles and image radii, and the pinhole by its distance."""

    angles_deg: tuple[float, ...]
    """Increasing angles theta of scene rays from the axis, the first 0."""
    image_radii: tuple[float, ...]
    """Increasing image radii over the focal length, tan(psi), the first 0."""
    vertex_distance_m: float
    """Distance from the vertex to the pinhole, > 0."""
    rim_rad: float = math.radians(120.0)
    """Angle of the scene ray at the mirror's edge, at most the last of the table."""

    def __post_init__(self) -> None:
        check_vertex_distance(self.vertex_distance_m)
        check_column("angles", self.angles_deg)
        check_column("image radii", self.image_radii)
        if len(self.angles_deg) != len(self.image_radii):
            raise DomainError(
                f"a table of {len(self.angles_deg)} angles needs as many image radii, not "
                f"{len(self.image_radii)}"
            )
        last_deg = self.angles_deg[-1] + math.degrees(arctan(self.image_radii[-1]))
        if last_deg >= 180.0:
            raise DomainError(
                f"the last angle and that of its camera ray must be below 180 deg together, not "
                f"{last_deg:.3f}"
            )
        _check_curve(self)
        check_rim(self)

    @property
    def psi_limit(self) -> float:
        """Camera angle just behind the last image radius."""
        return arctan(self.image_radii[-1]) * (1.0 + 2.0 * _SLACK)

    def reflect(self, psi: Floats) -> Reflection:
        """Reflect camera rays. Domain: 0 <= psi <= psi_limit."""
        spline, tangent = _spline(self), tan(psi)
        theta = solve_increasing(
            lambda x: spline.evaluate(x)[0],
            lambda x: spline.evaluate(x)[1],
            tangent,
            (spline.knots, spline.values),
        )
        theta = np.reshape(theta, np.shape(psi))
        slope = (1.0 + np.square(tangent)) / spline.evaluate(theta)[1]
        distance = self.vertex_distance_m * exp(_log_distance(self).evaluate(theta)[0])
        return Reflection(theta, slope, distance * sin(psi), distance * cos(psi))

    def _psi_from_t(self, t: Floats) -> Floats:
        # The spline itself, without the inverse of its inverse.
        high = self.t_limit * (1.0 + _SLACK)
        expected = f"a mirror's ray needs 0 <= t = tan(theta / 2) <= {high!r}, its rim"
        require_domain((t >= 0.0) & (t <= high), t, expected)
        return np.asarray(arctan(_spline(self).evaluate(2.0 * arctan(t))[0]))


def _check_curve(mirror: RadialTableMirror) -> None:
    """Raise DomainError for a curve that turns back, or is no convex mirror's."""
    spline = _spline(mirror)
    if spline.smallest_slope() <= 0.0:
        raise DomainError(
            "the smooth curve through the table turns back: fewer knots, or radii without noise"
        )
    theta = np.linspace(0.0, spline.knots[-1], _MIN_INTERVALS + 1)
    ratio, slope, _ = spline.evaluate(theta)
    # Tilted ever more outwards: d(theta - psi) > 0.
    is_concave = slope >= 1.0 + np.square(ratio)
    if is_concave.any():
        at_deg = math.degrees(float(theta[int(np.argmax(is_concave))]))
        raise DomainError(
            f"no convex mirror has this table: at {at_deg:.3g} deg the camera ray turns faster "
            "than that of the scene; is the focal length in the unit of the radii?"
        )


@lru_cache(maxsize=64)
def _spline(mirror: RadialTableMirror) -> CubicSpline:
    angles = np.radians(mirror.angles_deg)
    return fit_spline(angles, np.array(mirror.image_radii), Symmetry.ODD)


@lru_cache(maxsize=64)
def _log_distance(mirror: RadialTableMirror) -> CubicSpline:
    """ln(D / D0) by theta: the integral of its slope, which is known, over fine intervals."""
    spline = _spline(mirror)
    parts = -(-_MIN_INTERVALS // (len(spline.knots) - 1))
    # No interval crosses a knot, where the third derivative jumps.
    fractions = np.arange(parts) / parts
    starts = (spline.knots[:-1, None] + np.diff(spline.knots)[:, None] * fractions).ravel()
    theta = np.append(starts, spline.knots[-1])
    half = 0.5 * np.diff(theta)
    nodes = theta[:-1, None] + half[:, None] * (1.0 + _NODES)
    areas = half * matmul(_log_slope(spline, nodes), _WEIGHTS)
    values = np.append(0.0, np.cumsum(areas))
    return CubicSpline(theta, values, _log_slope(spline, theta))


def _log_slope(spline: CubicSpline, theta: Floats) -> Floats:
    """d(ln D) / d(theta)."""
    ratio, slope, _ = spline.evaluate(theta)
    psi_slope = slope / (1.0 + np.square(ratio))
    return np.asarray(tan(0.5 * (theta + arctan(ratio))) * psi_slope)
