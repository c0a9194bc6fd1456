"""Surfaces of the mirrors from their publications, and pixels of points by the law of reflection.

Nothing here is the product's: a surface is a curve (r, depth from the pinhole) with its tangent,
and the image of a point is the one parameter whose reflected ray meets it, by bisection. The same
curves are the meshes that Mitsuba traces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.mirrors import MIRRORS
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from helpers.mirror_checks import MIRROR_EXAMPLES
from outside.findings import Finding, bisect, summarize

# Bisections of both sides leave 2^-52 of the rim; roundings of a surface's formula follow.
BOUND_PX = 1e-9
BOUND_M = 1e-12
# Inside it a mesh of triangles has its hub, where normals of needles meet.
HUB_RAD = math.radians(8.0)
DISTANCES_M = (0.15, 0.3, 1.0, 3.0)

_STEP = 1e-30


@dataclass(frozen=True, slots=True)
class Surface:
    """One mirror's profile."""

    curve: Callable[[Any], tuple[Any, Any]]
    """r and depth from the pinhole, of a telecentric camera from the viewpoint, by a parameter."""
    last: float
    """Parameter beyond the rim."""
    focal_px: float
    """Pixels per tan(psi), or per metre of r for a telecentric camera."""
    is_telecentric: bool = False

    def image_radius_px(self, parameter: Floats) -> Floats:
        """Image radii of points of the surface."""
        r, depth = self.curve(parameter)
        return np.asarray(self.focal_px * (r if self.is_telecentric else r / depth))


@dataclass(frozen=True, slots=True)
class MirrorCase:
    """A mirror model with numbers, those of the shipped camera where there is one."""

    name: str
    camera: OmniCamera
    surface: Surface
    source: str

    @property
    def pinhole_m(self) -> float:
        """Height from which depths are counted: of a telecentric camera, the viewpoint."""
        return 0.0 if self.surface.is_telecentric else self.camera.mirror.pinhole_distance_m


def differentiate(surface: Surface, parameter: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """r, depth and their derivatives, by a complex step: to the last digits."""
    r, depth = surface.curve(parameter + 1j * _STEP)
    return r.real, depth.real, r.imag / _STEP, depth.imag / _STEP


def reflect(surface: Surface, parameter: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """r, depth, and the direction (along r, along depth) of reflected camera rays."""
    r, depth, dr, dd = differentiate(surface, parameter)
    along_r, along_d = (0.0 * r, 1.0 + 0.0 * r) if surface.is_telecentric else (r, depth)
    length = np.hypot(along_r, along_d)
    # What runs along the tangent goes on, the rest turns round.
    twice = 2.0 * (along_r * dr + along_d * dd) / (length * (dr**2 + dd**2))
    return r, depth, twice * dr - along_r / length, twice * dd - along_d / length


def project_transcribed(case: MirrorCase, points: Floats) -> Floats:
    """(n, 2) pixels of (n, 3) points in the mirror frame, mirrored, the image's top along +x."""
    rho, depth_m = np.hypot(points[:, 0], points[:, 1]), case.pinhole_m - points[:, 2]

    def turned(parameter: Floats) -> Floats:
        r, depth, out_r, out_d = reflect(case.surface, parameter)
        return np.asarray((rho - r) * out_d - (depth_m - depth) * out_r)

    parameter = bisect(turned, np.zeros_like(rho), case.surface.last)
    offset = case.surface.image_radius_px(parameter)[:, None] * points[:, 1::-1] / rho[:, None]
    return np.asarray(case.camera.centre_px - offset)


def _hyperbola(k: float, c: float, r: Any) -> tuple[Any, Any]:
    # Eq. 1: (z - c/2)^2 - r^2 (k/2 - 1) = c^2 (k - 2) / (4 k), the sheet below c/2.
    return r, 0.5 * c + np.sqrt(0.25 * c * c * (k - 2.0) / k + r * r * (0.5 * k - 1.0))


def _equiangular(gain: float, distance: float, psi: Any) -> tuple[Any, Any]:
    half = 0.5 * (1.0 + gain)
    d = distance * np.cos(half * psi) ** (-1.0 / half)
    return d * np.sin(psi), d * np.cos(psi)


# tan(psi) of the table's mirror, an odd cubic: the spline through its values is the cubic itself.
_CUBIC = (0.085, 0.003)
_KNOTS_DEG = (0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 110.0)
_CUBIC_RADII = tuple(_CUBIC[0] * a + _CUBIC[1] * a**3 for a in map(math.radians, _KNOTS_DEG))
_PROFILE_RADII = tuple(0.01 * step for step in range(11))
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


def _table(distance: float, theta: Any) -> tuple[Any, Any]:
    # ln(D / D0) from 0 to theta by one rule of 32 nodes: smooth up to the rim, so exact.
    angles = 0.5 * theta[..., None] * (1.0 + _NODES)
    ratio = _CUBIC[0] * angles + _CUBIC[1] * angles**3
    slope = (_CUBIC[0] + 3.0 * _CUBIC[1] * angles**2) / (1.0 + ratio**2)
    growth = np.tan(0.5 * (angles + np.arctan(ratio))) * slope
    d = distance * np.exp((growth * _WEIGHTS).sum(axis=-1) * 0.5 * theta)
    psi = np.arctan(_CUBIC[0] * theta + _CUBIC[1] * theta**3)
    return d * np.sin(psi), d * np.cos(psi)


def mirror_cases() -> list[MirrorCase]:
    """All mirror models: rim in degrees, surface by the mirror and pixels per image radius."""
    table = (_KNOTS_DEG, _CUBIC_RADII, 0.1, math.radians(104.0))
    # Knots so far apart that a sag that is 1e-4 longer is still a mirror's.
    profile = (_PROFILE_RADII, tuple(r * r / 0.08 for r in _PROFILE_RADII), 0.15, 2.0)
    numbers_of = MIRROR_EXAMPLES | {"radial_table": table, "profile": profile}
    models: list[tuple[str, float, str, Callable[[Any, float], Surface]]] = [
        # The unit of the image is h = f / sqrt(k (k - 2)).
        ("hyperbolic", 120.0, "Schmits & Visser 2009, Eq. 1", lambda m, scale: Surface(
            partial(_hyperbola, m.k, m.c_m), 0.06, scale * math.sqrt(m.k * (m.k - 2.0)))),
        # z = (p^2 - r^2) / (2 p): depth is -z, counted from the viewpoint.
        ("parabolic", 105.0, "Nayar, CVPR 1997", lambda m, scale: Surface(
            lambda r: (r, 0.5 * (r * r / m.horizon_radius_m - m.horizon_radius_m)),
            2.0 * m.horizon_radius_m, scale / m.horizon_radius_m, is_telecentric=True)),
        ("spherical", 0.0, "Baker & Nayar, IJCV 35 (1999)", lambda m, scale: Surface(
            lambda a: (m.radius_m * np.sin(a), m.centre_distance_m - m.radius_m * np.cos(a)),
            math.acos(m.radius_m / m.centre_distance_m), scale)),
        ("conical", 0.0, "Baker & Nayar, IJCV 35 (1999)", lambda m, scale: Surface(
            lambda r: (r, m.apex_distance_m + r / math.tan(m.half_angle_rad)), 0.5, scale)),
        ("equiangular", 0.0, "Chahl & Srinivasan, Applied Optics 36 (1997)",
         lambda m, scale: Surface(partial(_equiangular, m.gain, m.vertex_distance_m),
                                  0.98 * math.pi / (1.0 + m.gain), scale)),
        ("profile", 0.0, "a cubic spline through a paraboloid is the paraboloid",
         lambda m, scale: Surface(lambda r: (r, m.vertex_distance_m
                                             + m.sags_m[1] * (r / m.radii_m[1]) ** 2),
                                  m.radii_m[-1], scale)),
        ("radial_table", 0.0, "Chahl & Srinivasan, with theta by a cubic", lambda m, scale: Surface(
            partial(_table, m.vertex_distance_m), math.radians(110.0), scale)),
    ]  # fmt: skip
    cases = []
    for name, rim_deg, source, surface in models:
        mirror: Any = MIRRORS[name](*numbers_of[name])
        rim = getattr(mirror, "rim_rad", math.radians(rim_deg))
        camera = camera_with_inscribed_rim(mirror, width_px=360, height_px=360, rim_rad=rim)
        cases.append(MirrorCase(name, camera, surface(mirror, camera.scale_px), source))
    return cases


def scatter_points(camera: OmniCamera, count: int, seed: int) -> tuple[Floats, Floats]:
    """(n, 3) points in the mirror frame at `DISTANCES_M` in turn, and their angles."""
    rng = np.random.default_rng(seed)
    low = max(2.0 * math.atan(camera.projection.t_min) + 0.04, math.radians(3.0))
    theta, azimuth = rng.uniform((low, -math.pi), (camera.rim_rad, math.pi), (count, 2)).T
    sine = np.sin(theta)
    units = np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)), axis=-1)
    return np.resize(DISTANCES_M, count)[:, None] * units, theta


def compare_mirror(case: MirrorCase, camera: OmniCamera | None = None) -> Iterator[Finding]:
    """Compare pixels of points by a case's camera, or by a mutant, with the publication."""
    count = 20_000 if camera is None else 500
    camera, authority = camera or case.camera, f"{case.source}, transcribed"
    points, _ = scatter_points(case.camera, count, seed=38)
    pinhole = replace(case, camera=camera).pinhole_m
    # Points stay where they are about the pinhole, whatever a mutant's viewpoint.
    shift = np.array((0.0, 0.0, pinhole - case.pinhole_m))
    ours, valid = pixel_from_point(camera, points + shift)
    apart = np.hypot(*(ours - project_transcribed(case, points))[valid].T)
    yield summarize(case.name, authority, apart, BOUND_PX, "px")
    # A mirror with one viewpoint has the same image in any size: its surface tells.
    r, depth, out_r, out_d = reflect(case.surface, np.linspace(1e-3, 0.5, 999) * case.surface.last)
    theta = np.arctan2(out_r, -out_d)
    shown = theta < case.camera.rim_rad
    found_r, found_z = camera.mirror.surface_point(np.tan(0.5 * theta[shown]))
    apart = np.hypot(found_r - r[shown], pinhole - found_z - depth[shown])
    yield summarize(case.name, authority + ": surface", apart, BOUND_M, "m")
