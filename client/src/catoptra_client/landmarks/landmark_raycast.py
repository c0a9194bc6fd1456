"""What of a landmark a ray meets first: exact geometry, for labels. No shading, no other objects.

A beacon is a cylinder with a lid, a goal three upright boards open to the world's origin, as
`catoptra_protocol.landmarks` describes them. World frame: z down, floor at z = 0, so a point at
height h has z = -h.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.classifier import COLOUR_CODES, NO_COLOUR
from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Bools, Floats

# The white post below a beacon's band: a landmark's, but of no landmark colour.
WHITE_CODE = 1 + max(COLOUR_CODES.values())


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays from one point: origin (3,), directions (n, 3), in the world frame."""

    origin: Floats
    directions: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Where rays meet a surface: distance (n,) along the direction, inf where not; code (n,)."""

    distances: Floats
    codes: UInt8Array


def nearest_surface_codes(rays: Rays, landmarks: Iterable[Landmark]) -> UInt8Array:
    """Return (n,) codes of what each ray meets first: a colour's, WHITE, or NO_COLOUR."""
    nearest = np.full(len(rays.directions), math.inf)
    codes = np.full(len(rays.directions), NO_COLOUR, dtype=np.uint8)
    for landmark in landmarks:
        for hits in _INTERSECTIONS[landmark.kind](rays, landmark):
            nearer = hits.distances < nearest
            nearest = np.where(nearer, hits.distances, nearest)
            codes = np.where(nearer, hits.codes, codes)
    return codes


def _intersect_beacon(rays: Rays, landmark: Landmark) -> list[Hits]:
    to_axis = np.array([landmark.x_m, landmark.y_m]) - rays.origin[:2]
    level = rays.directions[:, :2]
    # Solve |s level - to_axis| = radius for the nearer s.
    a = np.square(level).sum(axis=1)
    b = level @ to_axis
    c = float(to_axis @ to_axis) - (0.5 * landmark.width_m) ** 2
    root = np.square(b) - a * c
    meets = (root >= 0.0) & (a > 0.0) & (b > 0.0) & (c > 0.0)
    # c / (b + sqrt) is the nearer root without the cancellation of (b - sqrt) / a.
    distance = np.where(meets, c / np.where(meets, b + np.sqrt(np.maximum(root, 0.0)), 1.0), 0.0)
    height = -(rays.origin[2] + distance * rays.directions[:, 2])
    meets &= (height >= 0.0) & (height <= landmark.band_top_m)
    code = _band_code(landmark, height)
    side = Hits(np.where(meets, distance, math.inf), code)
    return [side, _intersect_cap(rays, landmark)]


def _band_code(landmark: Landmark, height: Floats) -> UInt8Array:
    lower, upper = COLOUR_CODES[landmark.lower_colour], COLOUR_CODES[landmark.upper_colour]
    coloured = np.where(height < landmark.band_centre_m, lower, upper)
    return np.where(height < landmark.band_bottom_m, WHITE_CODE, coloured).astype(np.uint8)


def _intersect_cap(rays: Rays, landmark: Landmark) -> Hits:
    """Return where rays meet the lid, seen only from above."""
    drop = -landmark.band_top_m - rays.origin[2]
    falls = rays.directions[:, 2] > 0.0
    distance = drop / np.where(falls, rays.directions[:, 2], 1.0)
    points = rays.origin[:2] + distance[:, None] * rays.directions[:, :2]
    off_axis = np.hypot(points[:, 0] - landmark.x_m, points[:, 1] - landmark.y_m)
    meets = falls & (distance > 0.0) & (off_axis <= 0.5 * landmark.width_m)
    code = np.full(len(falls), COLOUR_CODES[landmark.upper_colour], dtype=np.uint8)
    return Hits(np.where(meets, distance, math.inf), code)


def _intersect_goal(rays: Rays, landmark: Landmark) -> list[Hits]:
    half = 0.5 * landmark.width_m
    back = landmark.x_m + math.copysign(landmark.depth_m, landmark.x_m)
    depths = (min(landmark.x_m, back), max(landmark.x_m, back))
    widths = (landmark.y_m - half, landmark.y_m + half)
    boards = [(0, back, widths), (1, widths[0], depths), (1, widths[1], depths)]
    return [_intersect_board(rays, landmark, axis, at_m, span) for axis, at_m, span in boards]


def _intersect_board(
    rays: Rays, landmark: Landmark, axis: int, position_m: float, span: tuple[float, float]
) -> Hits:
    """Return where rays meet an upright board: at `at_m` of an axis, over a span of the other."""
    along = rays.directions[:, axis]
    distance = (position_m - rays.origin[axis]) / np.where(along == 0.0, math.nan, along)
    reach = np.where(distance > 0.0, distance, 0.0)
    points = rays.origin + reach[:, None] * rays.directions
    across, height = points[:, 1 - axis], -points[:, 2]
    meets = (reach > 0.0) & _is_within(across, *span) & _is_within(height, 0.0, landmark.band_top_m)
    code = _band_code(landmark, height)
    return Hits(np.where(meets, reach, math.inf), code)


def _is_within(values: Floats, low: float, high: float) -> Bools:
    return (values >= low) & (values <= high)


_INTERSECTIONS: dict[str, Callable[[Rays, Landmark], list[Hits]]] = {
    "beacon": _intersect_beacon,
    "goal": _intersect_goal,
}
