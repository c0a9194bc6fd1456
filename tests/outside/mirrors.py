"""Surfaces of the mirrors from their publications, and pixels of points by the law of reflection.

Nothing here is the product's: a surface is a curve (r, depth from the pinhole) with its tangent,
and the image of a point is the one parameter whose reflected ray meets it, by bisection. The same
curves are the meshes that Mitsuba traces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.mirrors import MIRRORS
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from helpers.mirror_checks import MIRROR_EXAMPLES
from outside.findings import Finding, summarize

# Bisections of both sides leave 2^-52 of the rim; roundings of a surface's formula follow.
BOUND_PX = 1e-9
BOUND_M = 1e-12
# Inside it a mesh of triangles has its hub, where normals of needles meet.
HUB_RAD = math.radians(8.0)
DISTANCES_M = (0.15, 0.3, 1.0, 3.0)

# r, depth from the pinhole (from any plane across the axis for a telecentric camera), and their
# derivatives, of (n,) parameters.
Curve = Callable[[Floats], tuple[Floats, Floats, Floats, Floats]]


@dataclass(frozen=True, slots=True)
class Surface:
    """One mirror's profile."""

    curve: Curve
    last: float
    """Parameter beyond the rim."""
    focal_px: float
    """Pixels per tan(psi), or per metre of r for a telecentric camera."""
    is_telecentric: bool = False


@dataclass(frozen=True, slots=True)
class MirrorCase:
    """A mirror model with numbers, those of the shipped camera where there is one."""

    name: str
    camera: OmniCamera
    surface: Surface
    source: str


def reflect(surface: Surface, parameter: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """r, depth, and the direction (along r, along depth) of reflected camera rays."""
    r, depth, dr, dd = surface.curve(parameter)
    along_r, along_d = (np.zeros_like(r), np.ones_like(r)) if surface.is_telecentric else (r, depth)
    length = np.hypot(along_r, along_d)
    along_r, along_d = along_r / length, along_d / length
    tangent = np.hypot(dr, dd)
    tangent_r, tangent_d = dr / tangent, dd / tangent
    # What runs along the tangent goes on, the rest turns round.
    twice = 2.0 * (along_r * tangent_r + along_d * tangent_d)
    return r, depth, twice * tangent_r - along_r, twice * tangent_d - along_d


def radius_px(surface: Surface, rho: Floats, depth_m: Floats) -> Floats:
    """Image radii of points at (n,) distances from the axis and depths."""

    def turned(parameter: Floats) -> Floats:
        r, depth, out_r, out_d = reflect(surface, parameter)
        return np.asarray((rho - r) * out_d - (depth_m - depth) * out_r)

    low, high = np.zeros_like(rho), np.full_like(rho, surface.last)
    sign = np.sign(turned(low + 1e-12 * surface.last))
    for _ in range(60):
        middle = 0.5 * (low + high)
        before = np.sign(turned(middle)) == sign
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    r, depth, _, _ = surface.curve(0.5 * (low + high))
    return surface.focal_px * (r if surface.is_telecentric else r / depth)


def project_transcribed(case: MirrorCase, points: Floats) -> Floats:
    """(n, 2) pixels of (n, 3) points in the mirror frame, mirrored, the image's top along +x."""
    rho = np.hypot(points[:, 0], points[:, 1])
    pinhole = case.camera.mirror.pinhole_distance_m
    depth = (0.0 if case.surface.is_telecentric else pinhole) - points[:, 2]
    radius = radius_px(case.surface, rho, depth)
    unit = points[:, :2] / rho[:, None]
    return np.asarray(case.camera.centre_px) - radius[:, None] * unit[:, ::-1]


def _hyperbolic(k: float, c: float) -> Curve:
    def curve(r: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        # Eq. 1: (z - c/2)^2 - r^2 (k/2 - 1) = c^2 (k - 2) / (4 k), the sheet below c/2.
        root = np.sqrt(c * c / 4.0 * (k - 2.0) / k + r * r * (k / 2.0 - 1.0))
        return r, c / 2.0 + root, np.ones_like(r), r * (k / 2.0 - 1.0) / root

    return curve


def _paraboloid(radius: float, vertex_depth: float) -> Curve:
    return lambda r: (r, vertex_depth + r * r / (2.0 * radius), np.ones_like(r), r / radius)


def _sphere(radius: float, distance: float) -> Curve:
    return lambda a: (radius * np.sin(a), distance - radius * np.cos(a),
                      radius * np.cos(a), radius * np.sin(a))  # fmt: skip


def _cone(half_angle: float, distance: float) -> Curve:
    slope = 1.0 / math.tan(half_angle)
    return lambda r: (r, distance + r * slope, np.ones_like(r), np.full_like(r, slope))


def _equiangular(gain: float, distance: float) -> Curve:
    def curve(psi: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        half = 0.5 * (1.0 + gain)
        d = distance * np.cos(half * psi) ** (-1.0 / half)
        growth = d * np.tan(half * psi)
        sine, cosine = np.sin(psi), np.cos(psi)
        return d * sine, d * cosine, growth * sine + d * cosine, growth * cosine - d * sine

    return curve


# tan(psi) of the table's mirror, an odd cubic: the spline through its values is the cubic itself.
_CUBIC = (0.085, 0.003)
_KNOTS_DEG = (0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 110.0)
_CUBIC_RADII = tuple(_CUBIC[0] * a + _CUBIC[1] * a**3 for a in map(math.radians, _KNOTS_DEG))
_PROFILE_RADII = tuple(0.01 * step for step in range(11))


def _table(distance: float) -> Curve:
    def psi_of(theta: Floats) -> tuple[Floats, Floats]:
        ratio = _CUBIC[0] * theta + _CUBIC[1] * theta**3
        return np.arctan(ratio), (_CUBIC[0] + 3.0 * _CUBIC[1] * theta**2) / (1.0 + ratio**2)

    def growth(theta: Floats) -> Floats:
        psi, slope = psi_of(theta)
        return np.asarray(np.tan(0.5 * (theta + psi)) * slope)

    nodes, weights = np.polynomial.legendre.leggauss(48)

    def curve(theta: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        # ln(D / D0) from 0 to theta by one rule of 48 nodes: smooth up to the rim, so exact.
        half = 0.5 * theta[..., None]
        area = (growth(half * (1.0 + nodes)) * weights).sum(axis=-1) * half[..., 0]
        d, (psi, slope) = distance * np.exp(area), psi_of(theta)
        sine, cosine, rate = np.sin(psi), np.cos(psi), d * growth(theta)
        dr, dd = rate * sine + d * slope * cosine, rate * cosine - d * slope * sine
        return d * sine, d * cosine, dr, dd

    return curve


def mirror_cases() -> list[MirrorCase]:
    """All mirror models."""
    table = (_KNOTS_DEG, _CUBIC_RADII, 0.1, math.radians(104.0))
    # Knots so far apart that a sag that is 1e-4 longer is still a mirror's.
    profile = (_PROFILE_RADII, tuple(r * r / 0.08 for r in _PROFILE_RADII), 0.15, 2.0)
    numbers_of = MIRROR_EXAMPLES | {"radial_table": table, "profile": profile}
    sources = {
        "hyperbolic": "Schmits & Visser 2009, Eq. 1",
        "parabolic": "Nayar, CVPR 1997",
        "spherical": "Baker & Nayar, IJCV 35 (1999)",
        "conical": "Baker & Nayar, IJCV 35 (1999)",
        "equiangular": "Chahl & Srinivasan, Applied Optics 36 (1997)",
        "profile": "a cubic spline through a paraboloid is the paraboloid",
        "radial_table": "Chahl & Srinivasan, with theta by a cubic",
    }
    cases = []
    for name, source in sources.items():
        mirror: Any = MIRRORS[name](*numbers_of[name])
        rim = getattr(mirror, "rim_rad", math.radians(105.0 if name == "parabolic" else 120.0))
        camera = camera_with_inscribed_rim(mirror, width_px=360, height_px=360, rim_rad=rim)
        cases.append(MirrorCase(name, camera, _surface(name, mirror, camera), source))
    return cases


def _surface(name: str, mirror: Any, camera: OmniCamera) -> Surface:
    scale = camera.scale_px
    if name == "hyperbolic":
        k = mirror.k
        # The unit of the image is h = f / sqrt(k (k - 2)).
        return Surface(_hyperbolic(k, mirror.c_m), 0.06, scale * math.sqrt(k * (k - 2.0)))
    if name == "parabolic":
        p = mirror.horizon_radius_m
        # z = (p^2 - r^2) / (2 p): depth is -z, counted from the viewpoint.
        return Surface(_paraboloid(p, -0.5 * p), 2.0 * p, scale / p, is_telecentric=True)
    if name == "spherical":
        radius, distance = mirror.radius_m, mirror.centre_distance_m
        return Surface(_sphere(radius, distance), math.acos(radius / distance), scale)
    if name == "conical":
        return Surface(_cone(mirror.half_angle_rad, mirror.apex_distance_m), 0.5, scale)
    if name == "equiangular":
        curve = _equiangular(mirror.gain, mirror.vertex_distance_m)
        return Surface(curve, 0.98 * math.pi / (1.0 + mirror.gain), scale)
    if name == "profile":
        radius = mirror.radii_m[1] ** 2 / (2.0 * mirror.sags_m[1])
        return Surface(_paraboloid(radius, mirror.vertex_distance_m), mirror.radii_m[-1], scale)
    return Surface(_table(mirror.vertex_distance_m), math.radians(110.0), scale)


def scatter_points(camera: OmniCamera, count: int, seed: int = 38) -> tuple[Floats, Floats]:
    """(n, 3) points in the mirror frame at `DISTANCES_M` within the rim, and their angles."""
    rng = np.random.default_rng(seed)
    low = max(2.0 * math.atan(camera.projection.t_min) + 0.02, HUB_RAD)
    theta = rng.uniform(low, camera.rim_rad - 0.05, count)
    azimuth = rng.uniform(-math.pi, math.pi, count)
    distance = rng.choice(DISTANCES_M, count)
    sine = np.sin(theta)
    unit = np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)), axis=-1)
    return distance[:, None] * unit, theta


def compare_mirror(case: MirrorCase, camera: OmniCamera | None = None) -> Iterator[Finding]:
    """Compare pixels of points by a case's camera, or by a mutant, with the publication."""
    count = 20_000 if camera is None else 500
    camera, authority = camera or case.camera, f"{case.source}, transcribed"
    points, _ = scatter_points(case.camera, count)
    ours, valid = _pixels(camera, case.camera, points)
    apart = np.hypot(*(ours - project_transcribed(case, points))[valid].T)
    yield summarize(case.name, authority, apart, BOUND_PX, "px")
    # A mirror with one viewpoint has the same image in any size: its surface tells.
    r, depth, out_r, out_d = reflect(case.surface, np.linspace(1e-3, 0.5, 999) * case.surface.last)
    theta = np.arctan2(out_r, -out_d)
    shown = theta < case.camera.rim_rad
    found_r, found_z = camera.mirror.surface_point(np.tan(0.5 * theta[shown]))
    pinhole = 0.0 if case.surface.is_telecentric else camera.mirror.pinhole_distance_m
    apart = np.hypot(found_r - r[shown], pinhole - found_z - depth[shown])
    yield summarize(case.name, authority + ": surface", apart, BOUND_M, "m")


def _pixels(camera: OmniCamera, true: OmniCamera, points: Floats) -> tuple[Floats, Bools]:
    """Pixels of points that stay where they are about the pinhole, whatever the viewpoint."""
    pinhole, truth = camera.mirror.pinhole_distance_m, true.mirror.pinhole_distance_m
    shift = 0.0 if math.isinf(truth) else pinhole - truth
    return pixel_from_point(camera, points + np.array((0.0, 0.0, shift)))
