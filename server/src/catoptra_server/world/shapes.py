"""Triangles of the primitive shapes, and the geometry of many triangles.

Each shape is built in its own frame (SAE: z down) as a `Patch`. Corners are counter-clockwise seen
from the lit side, so that cross(b - a, c - a) is the outward normal.

Normals and the box around all serve meshes of a million triangles. Components of a coordinate are
kept in arrays of their own within a block: NumPy's operations on (n, 3) arrays take several times
as long.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan2, cos, einsum, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.triangles import row_blocks
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Facets,
    Primitive,
    Rectangle,
    Ring,
    SphereBand,
)


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Triangles with texture coordinates."""

    corners: Floats
    """(n, 3, 3) float64 metres."""
    uv: Floats
    """(n, 3, 2)."""

    def translate(self, offset_m: tuple[float, float, float]) -> Patch:
        """Patch moved by an offset."""
        return Patch(self.corners + np.asarray(offset_m), self.uv)


def concatenate(patches: list[Patch]) -> Patch:
    """All patches as one."""
    corners = np.concatenate([patch.corners for patch in patches])
    return Patch(corners, np.concatenate([patch.uv for patch in patches]))


def max_triangles(shape: Primitive) -> int:
    """Number of triangles of a shape, before any is made; triangles without area count."""
    match shape:
        case Box():
            return 12
        case Cylinder():
            # The wall, and two discs of as many triangles as a quadrilateral each.
            return 6 * shape.sectors
        case Rectangle():
            return 2
        case Ring():
            return 2 * shape.sectors
        case SphereBand():
            return 2 * shape.sectors * shape.rings
        case Facets():
            return len(shape.corners)


def build_shape(shape: Primitive, tile_m: float = 0.0) -> Patch:
    """Build the triangles of a shape.

    Args:
        shape: Size and number of facets.
        tile_m: Side of a tile of the texture on every face; 0: a texture covers each face, and no
            disc. Whole tiles close a circle.
    """
    match shape:
        case Box():
            patch = box(shape)
        case Cylinder():
            return _cylinder(shape, tile_m)
        case Rectangle():
            patch = _rectangle(shape)
        case Ring():
            patch = _ring(shape)
        case SphereBand():
            return _sphere_band(shape, tile_m)
        case Facets():
            patch = Patch(shape.corners, shape.uv)
    return patch if tile_m == 0.0 else Patch(patch.corners, project_tiles(patch.corners, tile_m))


# Axes along which texture coordinates grow, to the right and down, on faces by the axis of their
# normals and its sign: as on a box, whose images are upright and not mirrored from outside.
_RIGHT = np.array([[[0, 1, 0], [0, -1, 0]], [[-1, 0, 0], [1, 0, 0]], [[0, 1, 0], [0, 1, 0]]])
_DOWN = np.array([[[0, 0, 1], [0, 0, 1]], [[0, 0, 1], [0, 0, 1]], [[-1, 0, 0], [1, 0, 0]]])


def project_tiles(corners: Floats, tile_m: float) -> Floats:
    """(n, 3, 2) texture coordinates of (n, 3, 3) triangles by square tiles of some metres.

    Along the coordinate plane that each faces most; a tile's lower left corner is in the corner of
    the box around all, for courses of bricks to begin at the floor.
    """
    normals, _ = facet_normals(corners)
    axis = np.abs(normals).argmax(axis=1)
    sign = (normals[np.arange(len(axis)), axis] > 0.0).astype(np.intp)
    along = np.stack((_RIGHT[axis, sign], _DOWN[axis, sign]), axis=1)
    low, high = bounding_box(corners)
    # Where a coordinate grows from the left, and ends at the bottom.
    begin = np.where(along > 0, low, high)
    begin[:, 1] = np.where(along[:, 1] > 0, high, low)
    from_corner = np.where(along[:, None] != 0, corners[:, :, None] - begin[:, None], 0.0)
    tiles: Floats = einsum("nkai,nai->nka", from_corner, along.astype(np.float64)) / tile_m
    return tiles


def _tiles_around(length_m: float, tile_m: float) -> float:
    """Whole tiles along a closed line; one without a size."""
    return max(round(length_m / tile_m), 1) if tile_m else 1.0


def box(shape: Box) -> Patch:
    """Six sides of a box."""
    x, y, z = (0.5 * length for length in shape.size_m)
    # Lower left corner of each side, right and up as seen from outside: right x up points outward,
    # so an image on the side is not mirrored.
    sides = [
        ((x, y, z), (0, -2 * y, 0), (0, 0, -2 * z)),
        ((-x, -y, z), (0, 2 * y, 0), (0, 0, -2 * z)),
        ((-x, y, z), (2 * x, 0, 0), (0, 0, -2 * z)),
        ((x, -y, z), (-2 * x, 0, 0), (0, 0, -2 * z)),
        ((-x, -y, -z), (0, 2 * y, 0), (2 * x, 0, 0)),
        ((x, -y, z), (0, 2 * y, 0), (-2 * x, 0, 0)),
    ]
    return concatenate([_side(origin, right, up) for origin, right, up in sides])


def _side(origin: tuple[float, ...], right: tuple[float, ...], up: tuple[float, ...]) -> Patch:
    o, r, u = (np.asarray(vector, dtype=np.float64) for vector in (origin, right, up))
    return _quad(o, o + r, o + r + u, o + u)


def _quad(a: Floats, b: Floats, c: Floats, d: Floats) -> Patch:
    """Two triangles of the corners a, b, c, d (counter-clockwise), textured 0..1."""
    corners = np.array([[a, b, c], [a, c, d]], dtype=np.float64)
    uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], dtype=np.float64)
    return Patch(corners, uv)


# Beacons of a field are alike, and so are the meshes of a robot: 0.5 ms each.
@lru_cache(maxsize=8)
def _cylinder(shape: Cylinder, tile_m: float) -> Patch:
    """Upright cylinder with two caps."""
    angle = np.linspace(0.0, 2.0 * math.pi, shape.sectors + 1)
    x, y = shape.radius_m * cos(angle), shape.radius_m * sin(angle)
    half = 0.5 * shape.height_m
    # Rings from bottom to top: rows of a grid run up.
    wall = np.stack([np.stack((x, y, np.full_like(x, z)), -1) for z in (half, -half)])
    # From outside the angle grows to the left, texture coordinates to the right.
    u = (1.0 - angle / (2.0 * math.pi)) * _tiles_around(2.0 * math.pi * shape.radius_m, tile_m)
    top_v = 1.0 - shape.height_m / tile_m if tile_m else 0.0
    uv = np.stack([np.stack((u, np.full_like(u, v)), -1) for v in (1.0, top_v)])
    side = grid(wall, uv)
    centres = side.corners.mean(axis=1) * (1.0, 1.0, 0.0)
    bottom, top = _disc(wall[0], outward=(0, 0, 1)), _disc(wall[1], outward=(0, 0, -1))
    if tile_m:
        bottom, top = (Patch(o.corners, project_tiles(o.corners, tile_m)) for o in (bottom, top))
    return concatenate([_orient_outward(side, outward=centres), bottom, top])


def _disc(rim: Floats, *, outward: tuple[float, float, float]) -> Patch:
    centre = np.broadcast_to(rim[:-1].mean(axis=0), rim.shape)
    patch = grid(np.stack((rim, centre)), np.zeros((2, len(rim), 2)))
    return _orient_outward(patch, outward=np.asarray(outward, dtype=np.float64))


def _rectangle(shape: Rectangle) -> Patch:
    """Level _rectangle that faces up; u runs along +y, v along -x."""
    x, y = (0.5 * length for length in shape.size_m)
    points = np.array([[[-x, -y, 0], [-x, y, 0]], [[x, -y, 0], [x, y, 0]]], dtype=np.float64)
    (ru, rv) = shape.texture_repeat
    uv = np.array([[[0, rv], [ru, rv]], [[0, 0], [ru, 0]]], dtype=np.float64)
    return _orient_outward(grid(points, uv), outward=np.array([0.0, 0.0, -1.0]))


def _ring(shape: Ring) -> Patch:
    """Level annulus that faces up."""
    angle = np.linspace(0.0, 2.0 * math.pi, shape.sectors + 1)
    circle = np.stack((cos(angle), sin(angle), np.zeros_like(angle)), -1)
    points = np.stack((shape.inner_radius_m * circle, shape.outer_radius_m * circle))
    return _orient_outward(
        grid(points, np.zeros((2, len(angle), 2))), outward=np.array([0.0, 0.0, -1.0])
    )


def _sphere_band(shape: SphereBand, tile_m: float) -> Patch:
    """Band of a sphere between two angles from +z; u runs right, v down as seen from its side."""
    # The last meridian repeats the first and so closes the band.
    azimuth = np.linspace(0.0, 2.0 * math.pi, shape.sectors + 1)
    angle = np.linspace(shape.from_rad, shape.to_rad, shape.rings + 1)[:, None]
    points = shape.radius_m * np.stack(
        (
            sin(angle) * cos(azimuth),
            sin(angle) * sin(azimuth),
            np.broadcast_to(cos(angle), (shape.rings + 1, shape.sectors + 1)),
        ),
        axis=-1,
    )
    side = 1.0 if shape.is_solid else -1.0
    # From outside the azimuth grows to the left.
    widest = shape.radius_m * float(sin(min(max(0.5 * math.pi, shape.from_rad), shape.to_rad)))
    u = (0.5 * (1.0 + side) - side * azimuth / (2.0 * math.pi)) * _tiles_around(
        2.0 * math.pi * widest, tile_m
    )
    length = tile_m / shape.radius_m or shape.to_rad - shape.from_rad or 1.0
    v = 1.0 - (angle - shape.from_rad) / length
    patch = grid(points, np.stack(np.broadcast_arrays(u, v), axis=-1))
    return _orient_outward(patch, outward=side * patch.corners.mean(axis=1))


def grid(points: Floats, uv: Floats) -> Patch:
    """Triangles of a grid of points, without those that have no area, as at a pole.

    Counter-clockwise when columns run right and rows run up, seen from the lit side.

    Args:
        points: (..., rows + 1, columns + 1, 3): grids one after the other.
        uv: (..., rows + 1, columns + 1, k).
    """

    def corners(values: Floats) -> Floats:
        upper, lower = values[..., :-1, :, :], values[..., 1:, :, :]
        a, c = upper[..., :-1, :], lower[..., 1:, :]
        both = np.zeros((*a.shape[:-1], 2, 3, a.shape[-1]))
        both[..., 0, 0, :] = both[..., 1, 0, :] = a
        both[..., 0, 2, :] = both[..., 1, 1, :] = c
        both[..., 0, 1, :], both[..., 1, 2, :] = upper[..., 1:, :], lower[..., :-1, :]
        return both.reshape(*a.shape[:-3], -1, 3, a.shape[-1])

    triangles = corners(points)
    edges = triangles[..., 1:, :] - triangles[..., :1, :]
    area = np.linalg.norm(np.cross(edges[..., 0, :], edges[..., 1, :]), axis=-1)
    # Relative to the largest: rounding leaves triangles at a pole a tiny area.
    solid = area > 1e-12 * area.max(axis=-1, keepdims=True, initial=1e-300)
    return Patch(triangles[solid], corners(uv)[solid])


def _orient_outward(patch: Patch, *, outward: Floats) -> Patch:
    """Patch wound so that its normals point along `outward`, (3,) or (n, 3)."""
    corners = patch.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = einsum("ij,ij->i", normals, np.broadcast_to(outward, normals.shape)) < 0.0
    order = np.where(inward[:, None], [0, 2, 1], [0, 1, 2])
    rows = np.arange(len(corners))[:, None]
    return Patch(corners[rows, order], patch.uv[rows, order])


def facet_normals(corners: Floats) -> tuple[Floats, Bools]:
    """Unit normals of (n, 3, 3) triangles by their winding, and whether each has an area.

    Returns:
        (n, 3) normals, 0 for a triangle without area, and (n,) triangles with an area, however
            small.
    """
    normals = np.zeros((len(corners), 3))
    has_area = np.zeros(len(corners), dtype=bool)
    for block in row_blocks(len(corners)):
        normals[block].T[:], has_area[block] = _unit_normals(corners[block])
    return normals, has_area


def _unit_normals(corners: Floats) -> tuple[Floats, Bools]:
    """(3, m) unit normals of (m, 3, 3) triangles, and the (m,) triangles with an area."""
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    b, c = b - a, c - a  # edges from the first corner
    # Relative to the longest edge: the product of two tiny edges would underflow.
    size = np.maximum(np.abs(b).max(axis=0), np.abs(c).max(axis=0))
    size[size == 0.0] = 1.0
    (bx, by, bz), (cx, cy, cz) = b / size, c / size
    cross = np.stack((by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx))
    length = np.sqrt(np.square(cross).sum(axis=0))
    has_area = length > 0.0
    return cross / np.where(has_area, length, 1.0), has_area


# Facets of a cylinder of 20 sectors turn by 18 degrees, and its ends by 90.
_MIN_SMOOTH_COSINE = cos(math.radians(30.0))


def smooth_normals(corners: Floats, facets: Floats) -> Floats:
    """(n, 3, 3) unit normals at the corners of (n, 3, 3) triangles.

    Of the (n, 3) normals of the triangles, `facets`, those that turn from the own one by less than
    30 degrees are averaged at each corner by their angles there; without any the own one is kept.
    """
    along, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine, cosine = np.linalg.norm(np.cross(along, back), axis=-1), (along * back).sum(axis=-1)
    points, own = corners.reshape(-1, 3), np.repeat(facets, 3, axis=0)
    weights = arctan2(sine, cosine).reshape(-1, 1) * own
    # Corners at one point, beside each other; points differ by rounding.
    cells = np.round(points / (1e-7 * max(float(np.ptp(points, axis=0).max()), 1e-300)))
    _, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    order = np.argsort(group, kind="stable")
    first, count = (np.cumsum(counts) - counts)[group], counts[group]
    total, is_flat = np.zeros(points.shape), np.ones((len(points), 1), dtype=bool)
    for turn in range(int(counts.max(initial=0))):
        # The corner of that turn at each point that has as many.
        rows = np.flatnonzero(turn < count)
        other = order[first[rows] + turn]
        near = einsum("ni,ni->n", own[rows], own[other])
        is_shared = near >= _MIN_SMOOTH_COSINE
        rows, other = rows[is_shared], other[is_shared]
        total[rows] += weights[other]
        is_flat[rows[near[is_shared] < 1.0 - 1e-9]] = False
    mean = total / np.maximum(np.linalg.norm(total, axis=-1, keepdims=True), 1e-300)
    return np.where(is_flat, own, mean).reshape(corners.shape)


def hit_normals(normals: Floats, triangles: npt.NDArray[np.int32]) -> Floats:
    """(m, 3) normals of hit triangles, from the (n, 3) of all; zero for -1, which is no hit."""
    hits = np.zeros((len(triangles), 3))
    is_hit = triangles >= 0
    hits[is_hit] = normals[triangles[is_hit]]
    return hits


# Coordinates in a row of a reduction: NumPy reduces long rows with vector instructions, rows of
# three one by one (10 in place of 240 ms for a million triangles). A multiple of three.
_REDUCTION_ROW = 576


def bounding_box(corners: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest (3,) coordinates of (n, 3, 3) triangles; inf and -inf without any."""
    flat = corners.reshape(-1)
    num_whole = len(flat) - len(flat) % _REDUCTION_ROW
    rows, rest = flat[:num_whole].reshape(-1, _REDUCTION_ROW), flat[num_whole:].reshape(-1, 3)
    low = rows.min(axis=0, initial=np.inf).reshape(-1, 3).min(axis=0)
    high = rows.max(axis=0, initial=-np.inf).reshape(-1, 3).max(axis=0)
    return (
        np.minimum(low, rest.min(axis=0, initial=np.inf)),
        np.maximum(high, rest.max(axis=0, initial=-np.inf)),
    )
