"""Which parts of the cube's faces a mirror looks at, and how many texels each part gets.

The picture itself says how fine a part must be: where the mirror spreads one radian over R pixels
along the radius and T pixels around it, a step on a face covers so many pixels, and a texel must
not be longer than one of them, or a share of one. The bottom, which the mirror shows smallest, so
needs a third of the side that the faces around need at the rim. Cutting those at the horizon would
save another third of the texels; but what stands across the cut is drawn twice, which costs a
scene of many triangles more than that.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.cube_map import (
    MIRROR_FROM_FACE_ROTATIONS,
    Face,
    face_coordinates,
    visible_faces,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.face_region import FaceRegion, FaceWindow

# All parts together: 512 MiB of linear light. The longest side leaves room for two in a texture.
MAX_TEXELS = 2**26
MAX_SIDE_TEXELS = 2**13
# Density changes so slowly that the largest of a grid of this side is the largest to 0.1 %.
_GRID_SIDE = 65


def visible_window(face: Face, max_incidence_rad: float) -> FaceWindow:
    """Return the smallest window of a face that holds all directions up to an incidence angle."""
    if face is Face.U:
        return FaceWindow()
    if face is Face.C:
        half = math.tan(max_incidence_rad) if max_incidence_rad < 0.25 * math.pi else 1.0
        return FaceWindow(-half, -half, half, half)
    # On a side face t = cot(theta) / cos(azimuth off its middle): smallest in the middle below the
    # horizon, at the edge of the face, sqrt 2 farther, above it.
    cotangent = 1.0 / math.tan(max_incidence_rad)
    highest = cotangent if cotangent > 0.0 else math.sqrt(2.0) * cotangent
    return FaceWindow(top=max(highest, -1.0))


def face_regions(
    camera: OmniCamera, max_incidence_rad: float, *, size_px: int, texels_per_px: float
) -> tuple[FaceRegion, ...]:
    """Return the parts up to an incidence angle: of a wished size, or by density where it is 0."""
    if size_px:
        return regions_of_size(max_incidence_rad, size_px)
    return regions_by_density(camera, max_incidence_rad, texels_per_px=texels_per_px)


def max_face_size_px(regions: tuple[FaceRegion, ...]) -> int:
    """Return the side of a whole face in the finest of the parts' texels."""
    return math.ceil(2.0 * max(max(part.columns_per_unit, part.rows_per_unit) for part in regions))


def regions_of_size(max_incidence_rad: float, size_px: int) -> tuple[FaceRegion, ...]:
    """Return a part of each face that is seen, all of `size_px` texels for 90 degrees."""
    windows = {
        face: visible_window(face, max_incidence_rad) for face in visible_faces(max_incidence_rad)
    }
    half = 0.5 * size_px
    return tuple(FaceRegion(f, w, half, half) for f, w in windows.items() if not w.is_empty)


def regions_by_density(
    camera: OmniCamera, max_incidence_rad: float, *, texels_per_px: float
) -> tuple[FaceRegion, ...]:
    """Return the parts that a picture needs up to an incidence angle.

    No texel is longer than a pixel over `texels_per_px`, unless the atlas would grow beyond all
    use: then all are coarser by one factor.
    """
    parts: list[FaceRegion] = []
    for seen in regions_of_size(max_incidence_rad, 2):
        if seen.face in (Face.N, Face.C, Face.U):
            fitted = _fit_texel_density(camera, max_incidence_rad, seen, texels_per_px)
        # The mirror is round: what fits one side face fits them all.
        parts.append(replace(fitted, face=seen.face))
    return _limit_texels(tuple(parts))


def _fit_texel_density(
    camera: OmniCamera, max_incidence_rad: float, region: FaceRegion, texels_per_px: float
) -> FaceRegion:
    """Return the part with as many texels as its densest place needs, in whole texels a face."""
    columns, rows = (
        0.5 * math.ceil(2.0 * texels_per_px * longest)
        for longest in _max_density(camera, max_incidence_rad, region)
    )
    return replace(region, columns_per_unit=columns, rows_per_unit=rows)


def _max_density(
    camera: OmniCamera, max_incidence_rad: float, region: FaceRegion
) -> tuple[float, float]:
    """Return the most pixels that a unit of s and a unit of t cover where the mirror looks."""
    window = region.window
    grid = np.meshgrid(
        np.linspace(window.left, window.right, _GRID_SIDE),
        np.linspace(window.top, window.bottom, _GRID_SIDE),
    )
    places = np.concatenate(
        (np.stack(grid, axis=-1).reshape(-1, 2), _boundary_points(max_incidence_rad, region))
    )
    covered = pixels_per_unit(camera, region.face, places)
    seen = (
        _incidence_rad(_directions_from_face_points(region.face, places))
        <= max_incidence_rad + 1e-9
    )
    columns, rows = covered[seen].max(axis=0)
    return float(columns), float(rows)


def _boundary_points(max_incidence_rad: float, region: FaceRegion) -> Floats:
    """Return (n, 2) places in a part's window on the circle of the highest incidence."""
    azimuth = np.linspace(-math.pi, math.pi, 8 * _GRID_SIDE + 1)
    ring = math.sin(max_incidence_rad)
    height = np.full_like(azimuth, math.cos(max_incidence_rad))
    circle = np.stack((ring * np.cos(azimuth), ring * np.sin(azimuth), height), axis=-1)
    ahead = circle[circle @ MIRROR_FROM_FACE_ROTATIONS[region.face][:, 0] > 1e-6]
    places = face_coordinates(ahead, np.full(len(ahead), region.face, dtype=np.intp))
    window = region.window
    low, high = (window.left, window.top), (window.right, window.bottom)
    inside: Floats = places[((places >= low) & (places <= high)).all(axis=-1)]
    return inside


def pixels_per_unit(camera: OmniCamera, face: Face, points: Floats) -> Floats:
    """Return (n, 2): pixels that a unit of s and of t covers at (n, 2) places on a face.

    A step across the direction of length n moves the picture by R / n along the radius and by
    T / n around it. Beyond the rim, where only coarse polygons look, the rim's density holds.
    """
    directions = _directions_from_face_points(face, points)
    x, y, z = directions.T
    rho, length = np.hypot(x, y), np.linalg.norm(directions, axis=-1)
    outwards = np.where(rho[:, None] > 0.0, directions[:, :2], (1.0, 0.0))
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    around = np.stack((-outwards[:, 1], outwards[:, 0], np.zeros_like(rho)), axis=-1)
    level, down = outwards * (z / length)[:, None], -rho / length
    along = np.concatenate((level, down[:, None]), axis=-1)
    radial, tangential = _pixels_per_radian(camera, np.arctan2(rho, z))
    steps = MIRROR_FROM_FACE_ROTATIONS[face][:, 1:]
    radial, tangential = radial / length, tangential / length
    covered: Floats = np.hypot(
        (along @ steps) * radial[:, None], (around @ steps) * tangential[:, None]
    )
    return covered


def _pixels_per_radian(camera: OmniCamera, incidence_rad: Floats) -> tuple[Floats, Floats]:
    """Return the (n,) pixels of a radian along the radius and around the axis."""
    # On the axis both are the same; a millionth of a radian off it their formulas have values.
    theta = np.clip(incidence_rad, 1e-6, camera.rim_rad)
    t = np.tan(0.5 * theta)
    h, mirror = camera.horizon_radius_px, camera.mirror
    return h * mirror.radius_ratio_slope(t), h * mirror.radius_ratio_from_t(t) / np.sin(theta)


def _directions_from_face_points(face: Face, points: Floats) -> Floats:
    """Return the (n, 3) directions of (n, 2) places, one unit ahead, in the mirror frame."""
    local = np.concatenate((np.ones((len(points), 1)), points), axis=-1)
    directions: Floats = local @ MIRROR_FROM_FACE_ROTATIONS[face].T
    return directions


def _incidence_rad(directions: Floats) -> Floats:
    x, y, z = directions.T
    return np.asarray(np.arctan2(np.hypot(x, y), z))


def _limit_texels(regions: tuple[FaceRegion, ...]) -> tuple[FaceRegion, ...]:
    """Return the parts, coarser by one factor if there are too many texels or too long sides."""
    most = MAX_TEXELS / sum(part.num_texels for part in regions)
    longest = MAX_SIDE_TEXELS / max(max(part.size_texels) for part in regions)
    factor = min(1.0, math.sqrt(most), longest)
    return tuple(
        replace(
            part,
            columns_per_unit=part.columns_per_unit * factor,
            rows_per_unit=part.rows_per_unit * factor,
        )
        for part in regions
    )
