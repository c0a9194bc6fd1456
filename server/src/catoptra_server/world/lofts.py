"""Closed solids as skins over outlines: turned parts, plates with chamfers, belts.

A loft joins outlines of equally many points and closes both ends. Each solid faces outwards,
whichever way its outlines turn. Whether an edge is round or hard is left to `smooth_normals`: sides
that turn by less than 30 degrees are round.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.elementary import (
    arccos,
    arctan2,
    cos,
    hypot,
    interpolate_linear,
    matmul,
    sin,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.shapes import Patch, grid


def loft(outlines: Sequence[Floats] | Floats) -> Patch:
    """Solid over (k, n, 3) closed outlines, whose ends are fans around their middles."""
    rings = np.asarray(outlines, dtype=np.float64)
    ends = [np.broadcast_to(ring.mean(axis=0), ring.shape) for ring in (rings[0], rings[-1])]
    rings = np.concatenate((ends[0][None], rings, ends[1][None]))
    rings = np.concatenate((rings, rings[:, :1]), axis=1)
    patch = grid(rings, np.zeros((*rings.shape[:2], 2)))
    a, b, c = np.moveaxis(patch.corners - rings.mean(axis=(0, 1)), 1, 0)
    if (a * np.cross(b, c)).sum() < 0.0:
        return Patch(patch.corners[:, ::-1], patch.uv[:, ::-1])
    return patch


def revolve(profile: Sequence[tuple[float, float]], sectors: int) -> Patch:
    """Solid of revolution about z: radius and z of each point of the profile, in order."""
    angle = np.linspace(0.0, 2.0 * math.pi, sectors, endpoint=False)
    around = np.stack((cos(angle), sin(angle)), axis=-1)
    return loft([np.insert(radius * around, 2, z, axis=1) for radius, z in profile])


def prism(outline: Floats, levels: Sequence[tuple[float, float]]) -> Patch:
    """Solid over a convex outline, (n, 2), counter-clockwise about z: z and inset of each level."""
    return loft([np.insert(_inset(outline, inset), 2, z, axis=1) for z, inset in levels])


def plate(outline: Floats, low: float, high: float, chamfer_m: float) -> Patch:
    """Prism between two z whose edges are cut by a chamfer."""
    c = min(chamfer_m, 0.49 * (high - low))
    return prism(outline, [(low, c), (low + c, 0.0), (high - c, 0.0), (high, c)])


def block(size_m: tuple[float, float, float], chamfer_m: float) -> Patch:
    """Box about the origin with cut edges."""
    x, y, z = (0.5 * length for length in size_m)
    cut = min(chamfer_m, 0.4 * x, 0.4 * y)
    return plate(octagon(x, y, cut, cut), -z, z, chamfer_m)


def octagon(x: float, y: float, cut_x: float, cut_y: float) -> Floats:
    """(8, 2) outline of a rectangle of half sides x, y with cut corners."""
    corner = np.array(((x, y - cut_y), (x - cut_x, y)))
    half = np.concatenate((corner, corner[::-1] * (-1.0, 1.0)))
    return np.concatenate((half, -half))


def tube(start: Sequence[float], end: Sequence[float], radius_m: float, sectors: int = 12) -> Patch:
    """Cylinder between two points."""
    x, y, z = np.subtract(end, start).tolist()
    length = hypot(x, y, z)
    pose = Pose.from_rpy(start, (0.0, arctan2(hypot(x, y), z), arctan2(y, x)))
    return transform(revolve([(radius_m, 0.0), (radius_m, float(length))], sectors), pose)


def belt(
    length_m: float, radii_m: tuple[float, float], width_m: float, lug_m: float, pitch_m: float
) -> Patch:
    """Belt with lugs around two wheels, the first at the origin, the other along x; axles along z.

    Args:
        length_m: Distance of the axles.
        radii_m: Radii over the lugs.
        width_m: Width, half of it on each side.
        lug_m: Height of the lugs.
        pitch_m: Distance of the lugs, about.
    """
    first, second = radii_m
    turn = float(arccos((first - second) / length_m))
    angle = np.concatenate((np.linspace(-turn, turn, 24), np.linspace(turn, math.tau - turn, 24)))
    at_end, radius = np.arange(48) < 24, np.repeat((second, first), 24)
    out = np.stack((cos(angle), sin(angle)), axis=-1)
    path = radius[:, None] * out + np.stack((at_end * length_m, 0.0 * angle), axis=-1)
    path, out = np.concatenate((path, path[:1])), np.concatenate((out, out[:1]))
    travel = np.append(0.0, np.cumsum(hypot(*np.diff(path, axis=0).T)))
    lugs = min(max(round(travel[-1] / pitch_m), 8), 64)
    # Foot, top, top and foot of each lug.
    place = (np.arange(lugs)[:, None] + (0.0, 0.12, 0.48, 0.6)).ravel() / lugs * travel[-1]
    depth = np.tile((lug_m, 0.0, 0.0, lug_m), lugs)
    at, normal = (
        np.stack([interpolate_linear(place, travel, of[:, axis]) for axis in (0, 1)], axis=-1)
        for of in (path, out)
    )
    outline = np.insert(at - depth[:, None] * normal, 2, 0.0, axis=1)
    side = np.array((0.0, 0.0, 0.5 * width_m))
    return loft([outline - side, outline + side])


def transform(patch: Patch, pose: Pose) -> Patch:
    """Patch at a pose."""
    return Patch(pose.transform_points(patch.corners), patch.uv)


def distance_out(outline: Floats, point: Floats, direction: Floats) -> float:
    """Distance from a point within a convex outline to the outline; 0 from outside."""
    normal = _outward_normals(outline)
    rate = matmul(normal, direction[:2])
    gap = (normal * (outline - point[:2])).sum(axis=1)
    # Sides that the ray leaves by.
    distances = gap[rate > 1e-9] / rate[rate > 1e-9]
    return max(float(distances.min()), 0.0) if len(distances) else 0.0


def _outward_normals(outline: Floats) -> Floats:
    """(n, 2) normals of the sides of an outline, as long as these."""
    along = np.roll(outline, -1, axis=0) - outline
    return np.stack((along[:, 1], -along[:, 0]), axis=-1)


def _inset(outline: Floats, inset: float) -> Floats:
    """Convex outline with each side moved inwards."""
    normal = _outward_normals(outline)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    before = np.roll(normal, 1, axis=0)
    cosine = (normal * before).sum(axis=1, keepdims=True)
    moved: Floats = outline - inset * (normal + before) / (1.0 + cosine)
    return moved
