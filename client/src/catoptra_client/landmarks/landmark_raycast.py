"""Ray casting of landmarks: the nearest surface along each ray, for labels.

Exact geometry without shading or other objects. A beacon is a cylinder with a lid, a goal three
upright boards open to the world's origin, as in `catoptra_protocol.landmarks`. World frame: z down,
floor at z = 0, so a point at height h has z = -h.
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

# White post below a beacon's band: part of a landmark, so neither a colour nor a negative.
WHITE_CODE = 1 + max(COLOUR_CODES.values())


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays in the world frame."""

    origin: Floats
    """Origin (3,) of all, or (n, 3) of each, in metres."""
    directions: Floats
    """Directions (n, 3), of any length."""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Intersections of rays with a surface."""

    distances: Floats
    """Distances (n,) in units of the direction's length; inf for a miss."""
    codes: UInt8Array
    """Colour codes (n,) of the surface."""


def nearest_surface_codes(rays: Rays, landmarks: Iterable[Landmark]) -> UInt8Array:
    """Code (n,) of the nearest surface along each ray: a colour's, `WHITE_CODE`, or `NO_COLOUR`."""
    nearest = np.full(len(rays.directions), math.inf)
    codes = np.full(len(rays.directions), NO_COLOUR, dtype=np.uint8)
    for landmark in landmarks:
        for hits in _INTERSECTIONS[landmark.kind](rays, landmark):
            nearer = hits.distances < nearest
            nearest = np.where(nearer, hits.distances, nearest)
            codes = np.where(nearer, hits.codes, codes)
    return codes


def _intersect_beacon(rays: Rays, landmark: Landmark) -> list[Hits]:
    to_axis = np.array([landmark.x_m, landmark.y_m]) - rays.origin[..., :2]
    level = rays.directions[:, :2]
    # Solve |s level - to_axis| = radius for the nearer s.
    a = np.square(level).sum(axis=1)
    b = (level * to_axis).sum(axis=-1)
    c = np.square(to_axis).sum(axis=-1) - (0.5 * landmark.width_m) ** 2
    root = np.square(b) - a * c
    hits = (root >= 0.0) & (a > 0.0) & (b > 0.0) & (c > 0.0)
    # c / (b + sqrt) is the nearer root without the cancellation of (b - sqrt) / a.
    distance = np.where(hits, c / np.where(hits, b + np.sqrt(np.maximum(root, 0.0)), 1.0), 0.0)
    height = -(rays.origin[..., 2] + distance * rays.directions[:, 2])
    hits &= (height >= 0.0) & (height <= landmark.band_top_m)
    code = _band_code(landmark, height)
    side = Hits(np.where(hits, distance, math.inf), code)
    return [side, _intersect_cap(rays, landmark)]


def _band_code(landmark: Landmark, height: Floats) -> UInt8Array:
    lower, upper = COLOUR_CODES[landmark.lower_colour], COLOUR_CODES[landmark.upper_colour]
    coloured = np.where(height < landmark.band_centre_m, lower, upper)
    return np.where(height < landmark.band_bottom_m, WHITE_CODE, coloured).astype(np.uint8)


def _intersect_cap(rays: Rays, landmark: Landmark) -> Hits:
    """Intersections with the lid, from above only."""
    drop = -landmark.band_top_m - rays.origin[..., 2]
    descends = rays.directions[:, 2] > 0.0
    distance = drop / np.where(descends, rays.directions[:, 2], 1.0)
    points = rays.origin[..., :2] + distance[:, None] * rays.directions[:, :2]
    off_axis = np.hypot(points[:, 0] - landmark.x_m, points[:, 1] - landmark.y_m)
    hits = descends & (distance > 0.0) & (off_axis <= 0.5 * landmark.width_m)
    code = np.full(len(descends), COLOUR_CODES[landmark.upper_colour], dtype=np.uint8)
    return Hits(np.where(hits, distance, math.inf), code)


def _intersect_goal(rays: Rays, landmark: Landmark) -> list[Hits]:
    half = 0.5 * landmark.width_m
    # The goal is open to the world's origin: the back lies behind the mouth, away from the origin.
    back = landmark.x_m + math.copysign(landmark.depth_m, landmark.x_m)
    depths = (min(landmark.x_m, back), max(landmark.x_m, back))
    widths = (landmark.y_m - half, landmark.y_m + half)
    boards = [(0, back, widths), (1, widths[0], depths), (1, widths[1], depths)]
    return [_intersect_board(rays, landmark, axis, at_m, span) for axis, at_m, span in boards]


def _intersect_board(
    rays: Rays, landmark: Landmark, axis: int, position_m: float, span: tuple[float, float]
) -> Hits:
    """Intersections with an upright board at `position_m` on an axis, over a span of the other."""
    normal_component = rays.directions[:, axis]
    # NaN marks parallel rays: every comparison below is then false, so the ray misses.
    divisor = np.where(normal_component == 0.0, math.nan, normal_component)
    distance = (position_m - rays.origin[..., axis]) / divisor
    reach = np.where(distance > 0.0, distance, 0.0)
    points = rays.origin + reach[:, None] * rays.directions
    lateral, height = points[:, 1 - axis], -points[:, 2]
    hits = (reach > 0.0) & _is_within(lateral, *span) & _is_within(height, 0.0, landmark.band_top_m)
    code = _band_code(landmark, height)
    return Hits(np.where(hits, reach, math.inf), code)


def _is_within(values: Floats, low: float, high: float) -> Bools:
    return (values >= low) & (values <= high)


_INTERSECTIONS: dict[str, Callable[[Rays, Landmark], list[Hits]]] = {
    "beacon": _intersect_beacon,
    "goal": _intersect_goal,
}
