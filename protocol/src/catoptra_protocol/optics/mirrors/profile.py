"""Measured mirror: its profile by radius, under a pinhole camera.

The sag is the distance of the surface behind the plane through its vertex, at a distance r from the
axis; an even function with a cubic spline between knots, so that its slope is smooth. The camera
ray tan(psi) = r / (d + sag) is reflected to theta = psi + 2 atan(sag'). In general not central.
Domain: to the last knot; a profile whose rays turn back is rejected.
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
    tabulate,
)
from catoptra_protocol.optics.elementary import arctan, arctan2, tan
from catoptra_protocol.optics.mirrors.non_central import (
    NonCentralMirror,
    Reflection,
    check_rim,
    check_vertex_distance,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass

_NUM_CHECKS = 4097


@dataclass(frozen=True, slots=True)
class ProfileMirror(NonCentralMirror):
    """Mirror by a table of its profile, and the pinhole by its distance from the vertex."""

    radii_m: tuple[float, ...]
    """Increasing distances from the axis, the first 0."""
    sags_m: tuple[float, ...]
    """Distances behind the vertex's plane, the first 0."""
    vertex_distance_m: float
    """Distance from the vertex to the pinhole, > 0."""
    rim_rad: float = math.radians(120.0)
    """Angle of the scene ray at the mirror's edge."""

    def __post_init__(self) -> None:
        check_vertex_distance(self.vertex_distance_m)
        _check_table(self.radii_m, self.sags_m)
        radius = np.linspace(0.0, self.radii_m[-1], _NUM_CHECKS)
        psi, theta = _angles(self, radius)
        for name, angles in (("camera", psi), ("scene", theta)):
            if not (np.diff(angles) > 0.0).all():
                at = float(radius[int(np.argmax(np.diff(angles) <= 0.0))])
                raise DomainError(
                    f"the profile's {name} rays turn back at a radius of {at:g} m: fewer knots, or "
                    "sags without noise"
                )
        check_rim(self)

    @property
    def psi_limit(self) -> float:
        """Camera angle of the last knot."""
        return arctan2(self.radii_m[-1], self.vertex_distance_m + self.sags_m[-1])

    def reflect(self, psi: Floats) -> Reflection:
        """Reflect camera rays. Domain: 0 <= psi <= psi_limit."""
        spline = _spline(self)

        def tangent(radius: Floats) -> Floats:
            return radius / (self.vertex_distance_m + spline.evaluate(radius)[0])

        def tangent_slope(radius: Floats) -> Floats:
            sag, first, _ = spline.evaluate(radius)
            depth = self.vertex_distance_m + sag
            return (depth - radius * first) / np.square(depth)

        table = _tangent_table(self)
        radius = solve_increasing(tangent, tangent_slope, tan(psi), table)
        sag, first, second = spline.evaluate(radius)
        depth = self.vertex_distance_m + sag
        # d(psi) / dr = d(tan(psi)) / dr cos^2(psi)
        psi_slope = tangent_slope(radius) / (1.0 + np.square(radius / depth))
        slope = 1.0 + 2.0 * second / (1.0 + np.square(first)) / psi_slope
        return Reflection(psi + 2.0 * arctan(first), slope, radius, depth)


def _check_table(radii_m: tuple[float, ...], sags_m: tuple[float, ...]) -> None:
    """Raise DomainError unless a table is a profile from the axis on."""
    check_column("radii", radii_m)
    if not isinstance(sags_m, tuple) or len(sags_m) != len(radii_m):
        raise DomainError(f"a profile of {len(radii_m)} radii needs as many sags")
    if not all(map(math.isfinite, sags_m)) or sags_m[0] != 0.0:
        raise DomainError(f"a profile is finite and starts at the vertex, sag 0: {sags_m[0]!r}")


def _angles(mirror: ProfileMirror, radius: Floats) -> tuple[Floats, Floats]:
    """Camera and scene angles of points of the surface."""
    sag, first, _ = _spline(mirror).evaluate(radius)
    psi = arctan2(radius, mirror.vertex_distance_m + sag)
    return psi, psi + 2.0 * arctan(first)


@lru_cache(maxsize=64)
def _spline(mirror: ProfileMirror) -> CubicSpline:
    return fit_spline(np.array(mirror.radii_m), np.array(mirror.sags_m), Symmetry.EVEN)


@lru_cache(maxsize=64)
def _tangent_table(mirror: ProfileMirror) -> tuple[Floats, Floats]:
    spline = _spline(mirror)
    return tabulate(
        lambda radius: radius / (mirror.vertex_distance_m + spline.evaluate(radius)[0]),
        0.0,
        mirror.radii_m[-1],
    )
