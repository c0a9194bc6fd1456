"""Grids of nodes over the surfaces of a scene, for ambient occlusion and baked light.

Flat surfaces get grids of nodes over their bounding rectangles, the outermost nodes on the border;
triangles of no flat surface get two by two nodes, where there are many of them neighbours of like
direction together. A node inside a solid, which nobody sees, continues its neighbours' values: a
floor goes on below a crate, and interpolation would darken the floor beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import dot, einsum, solve_linear
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.kernel.library import (
    KernelDevice,
    KernelUnavailableError,
    choose_instruction_set,
)
from catoptra_server.render.trace.kernel.scene_arrays import FlatSurfaces, find_flat_surfaces
from catoptra_server.render.trace.occlusion.occlusion_cache import MANY_TRIANGLES, MIN_SIDE_M
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import BLOCK, find_grid_nodes

# A byte each, on the device as well.
_MAX_TEXELS = 2_000_000
# Between nodes: fine enough for the foot of a goal post.
MIN_NODE_DISTANCE_M = 0.05
# Nodes along a side, whatever the surface's size: OpenGL 3.3 guarantees textures of 1024 texels.
_MAX_SIDE_NODES = 1000
# Grids of whole surfaces, the largest; each is compared with each box of casters.
_MAX_SURFACES = 4000
# Of triangles of no flat surface: four nodes each, of the 48 000 that are measured.
_MAX_SMALL_GRIDS = 8000
# Between triangles that share a grid: the components of their normals beyond a third agree in sign.
_DIRECTIONS_PER_UNIT = 3.0
# Rays start before their surface: above markings on a floor, which occlude nothing, and off the
# border, where another surface begins.
_BIAS_M = 0.003
_INSET_M = 0.005
# Rows of nodes inside a solid that the filter or an interpolation near a visible node reaches.
_NUM_FILLED = 2
# Shorter sides are left as they are: the tent would level their only steps.
_MIN_FILTERED = 4
_DIRECTIONS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]
_Indices = npt.NDArray[np.int32]
_Numbers = npt.NDArray[np.intp]
_ROWS = ("origin", "side_x", "side_y", "normal")


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFrames:
    """Coordinate systems of m surfaces: point = origin + s side_x + t side_y, s and t in [0, 1]."""

    patch_of: _Indices
    """(n,) surface of each triangle, -1 for none."""
    origin: Floats
    """(m, 3) corner of the rectangle, world frame, metres."""
    side_x: Floats
    """(m, 3) one side of the rectangle."""
    side_y: Floats
    """(m, 3) the other."""
    normal: Floats
    """(m, 3) unit, outward."""

    def take(self, surfaces: npt.NDArray[np.intp]) -> SurfaceFrames:
        """Some of the surfaces, numbered anew; triangles of the others have none."""
        number = np.full(len(self.origin) + 1, -1, dtype=np.int32)
        number[surfaces] = np.arange(len(surfaces), dtype=np.int32)
        return replace(self.take_rows(surfaces), patch_of=number[self.patch_of])

    def take_rows(self, surfaces: npt.NDArray[np.intp]) -> SurfaceFrames:
        """Rows of some surfaces, some perhaps repeated; triangles keep their numbers."""
        return SurfaceFrames(self.patch_of, *(getattr(self, name)[surfaces] for name in _ROWS))

    def transpose(self) -> SurfaceFrames:
        """Surfaces with their sides exchanged."""
        return replace(self, side_x=self.side_y, side_y=self.side_x)


@dataclass(frozen=True, slots=True, eq=False)
class GridLayout:
    """Places of m grids in an atlas."""

    columns: _Indices
    """(m,) nodes along side x, at least 2."""
    rows: _Indices
    """(m,) nodes along side y, at least 2."""
    left: _Indices
    """(m,) first column in the atlas."""
    top: _Indices
    """(m,) first row."""
    width: int
    """Columns of the atlas."""
    height: int
    """Rows of the atlas."""
    grid: _Indices
    """(h, w) number of the grid that each node of the atlas belongs to; -1 for none."""

    @property
    def is_filtered(self) -> tuple[Bools, Bools]:
        """(m,) grids long enough for a tent along side x, and along side y."""
        return self.columns >= _MIN_FILTERED, self.rows >= _MIN_FILTERED

    def bounds(self) -> _Indices:
        """(m, 4) first column, first row, last column, last row of each grid."""
        last = self.left + self.columns - 1, self.top + self.rows - 1
        return np.stack((self.left, self.top, *last), axis=-1).astype(np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Nodes to be measured."""

    positions: Floats
    """(k, 3) before their surfaces, metres."""
    patch: npt.NDArray[np.intp]
    """(k,) surface of each."""
    ray_set: npt.NDArray[np.intp]
    """(k,) set of directions."""


def frame_surfaces(scene: SceneMesh, *, threads: int, share: float = 1.0) -> SurfaceFrames:
    """Coordinate systems of the lit surfaces of a scene, by a share of the most grids."""
    flat = _find_surfaces(scene, threads)
    largest = _choose_largest(scene, flat, round(share * _MAX_SURFACES))
    number = np.full(len(flat.representative), -1, dtype=np.int32)
    number[largest] = np.arange(len(largest), dtype=np.int32)
    patch_of, representative = number[flat.surface], flat.representative[largest]
    large = _frame_large(scene, patch_of, representative)
    is_small = (patch_of < 0) & ~scene.unlit & scene.normals.any(axis=1)
    small = np.flatnonzero(is_small).astype(np.int32)
    group, middle = _join_neighbours(scene, small, round(share * _MAX_SMALL_GRIDS))
    joined = _frame_groups(scene, small, group, middle)
    patch_of[small] = len(representative) + group
    frames = _join_frames(patch_of, large, joined)
    # Unlit surfaces show their albedo; one without an area has no plane.
    is_lit = np.concatenate((~scene.unlit[representative], np.ones(len(middle), dtype=bool)))
    has_area = (_lengths(frames.side_x) > 0.0) & (_lengths(frames.side_y) > 0.0)
    return frames.take(np.flatnonzero(is_lit & has_area & frames.normal.any(axis=-1)))


def add_spare_grid(scene: SceneMesh, frames: SurfaceFrames) -> tuple[SurfaceFrames, bool]:
    """Grids, the last for all lit triangles that have none; and whether there is one."""
    is_lost = (frames.patch_of < 0) & ~scene.unlit
    if not is_lost.any():
        return frames, False
    patch_of = np.where(is_lost, np.int32(len(frames.origin)), frames.patch_of).astype(np.int32)
    x, y, z = np.eye(3)[:, None]
    spare = SurfaceFrames(patch_of, scene.centre[None], x, y, -z)
    return _join_frames(patch_of, frames, spare), True


def _join_frames(patch_of: _Indices, *parts: SurfaceFrames) -> SurfaceFrames:
    rows = (np.concatenate([getattr(one, name) for one in parts]) for name in _ROWS)
    return SurfaceFrames(patch_of, *rows)


def _find_surfaces(scene: SceneMesh, threads: int) -> FlatSurfaces:
    """Flat surfaces; where no kernel runs, each triangle is one, with more nodes than it needs."""
    try:
        device = KernelDevice(choose_instruction_set(), threads)
    except KernelUnavailableError:
        alone = np.arange(len(scene), dtype=np.int32)
        return FlatSurfaces(alone, np.full(len(scene), 7, dtype=np.uint8), alone)
    try:
        return find_flat_surfaces(scene, device)
    finally:
        device.close()


def _join_neighbours(
    scene: SceneMesh, small: _Indices, max_grids: int
) -> tuple[_Indices, _Indices]:
    """Grids of small triangles: one each, or one for neighbours where that were too many.

    Returns:
        (k,) grid of each of (k,) triangles, and (m,) triangle in the middle of each grid.
    """
    group = np.arange(len(small))
    if len(small) <= max_grids:
        return group.astype(np.int32), small
    normals = scene.normals[small]
    first, second, third = np.moveaxis(scene.corners[small], 1, 0)
    area_m2 = 0.5 * float(_lengths(np.cross(second - first, third - first)).sum())
    side_m = 0.5 * np.sqrt(area_m2 / max_grids)
    places = np.column_stack(
        ((first + second + third) / 3.0, np.sign(np.trunc(_DIRECTIONS_PER_UNIT * normals)))
    )
    # By what is left of the last round: a million triangles are sorted once.
    while len(places) > max_grids:
        cells = np.column_stack((np.floor(places[:, :3] / side_m), places[:, 3:]))
        order = np.lexsort(cells.T)
        is_new = np.append(True, (np.diff(cells[order], axis=0) != 0.0).any(axis=1))
        number = np.zeros(len(places), dtype=np.intp)
        number[order] = np.cumsum(is_new) - 1
        group, places = number[group], places[order[is_new]]
        side_m *= 1.2
    # The triangle that faces most as all together do.
    sums = np.stack([np.bincount(group, component) for component in normals.T], axis=-1)
    order = np.lexsort((-dot(normals, np.asarray(sums[group], dtype=np.float64)), group))
    middle = small[order[np.searchsorted(group[order], np.arange(len(places)))]]
    return group.astype(np.int32), middle


def _frame_groups(
    scene: SceneMesh, small: _Indices, group: _Indices, middle: _Indices
) -> SurfaceFrames:
    """Parallelograms over single triangles, rectangles in front of those that share a grid."""
    group_of = np.full(len(scene), -1, dtype=np.int32)
    group_of[small] = group
    frames = _frame_large(scene, group_of, middle)
    from_origin = scene.corners[small] - frames.origin[group][:, None]
    height = einsum("tci,ti->tc", from_origin, frames.normal[group]).max(axis=1)
    highest = np.zeros(len(middle))
    np.maximum.at(highest, group, height)
    first, second, third = np.moveaxis(scene.corners[middle], 1, 0)
    is_single = (np.bincount(group, minlength=len(middle)) == 1)[:, None]
    return replace(
        frames,
        origin=np.where(is_single, first, frames.origin + highest[:, None] * frames.normal),
        side_x=np.where(is_single, second - first, frames.side_x),
        side_y=np.where(is_single, third - first, frames.side_y),
    )


def _choose_largest(scene: SceneMesh, flat: FlatSurfaces, count: int) -> _Numbers:
    """(m,) surfaces of the largest areas, in their order."""
    first, second, third = np.moveaxis(scene.corners, 1, 0)
    area = np.bincount(flat.surface, _lengths(np.cross(second - first, third - first)))
    largest = np.argsort(-area, kind="stable")[:count]
    if len(scene) > MANY_TRIANGLES:
        # The product of two edges, twice the area.
        largest = largest[area[largest] >= MIN_SIDE_M**2]
    return np.sort(largest)


def _frame_large(scene: SceneMesh, patch_of: _Indices, representative: _Indices) -> SurfaceFrames:
    """Bounding rectangles of flat surfaces along axes of their planes."""
    normal = scene.normals[representative]
    # The horizontal tangent, so that rows of nodes follow floors along walls; on a floor, the
    # world's x axis.
    horizontal = np.cross(np.array([0.0, 0.0, 1.0]), normal)
    is_level = _lengths(horizontal) < 1e-3
    axis_x = np.where(is_level[:, None], np.array([1.0, 0.0, 0.0]), horizontal)
    axis_x -= einsum("mi,mi->m", axis_x, normal)[:, None] * normal
    axis_x /= np.maximum(_lengths(axis_x), 1e-12)[:, None]
    axis_y = np.cross(normal, axis_x)
    triangles = np.flatnonzero(patch_of >= 0)
    anchor = scene.corners[representative, 0]
    axes = np.stack((axis_x, axis_y), axis=1)
    low, high = _extents(scene.corners[triangles], anchor, axes, patch_of[triangles])
    return SurfaceFrames(
        patch_of,
        anchor + low[:, :1] * axis_x + low[:, 1:] * axis_y,
        (high - low)[:, :1] * axis_x,
        (high - low)[:, 1:] * axis_y,
        normal,
    )


def _extents(
    corners: Floats, anchor: Floats, axes: Floats, surface: _Indices
) -> tuple[Floats, Floats]:
    """(m, 2) least and largest coordinates of the triangles of each surface along its axes."""
    from_anchor = corners - anchor[surface][:, None]
    along = einsum("tci,tki->tck", from_anchor, axes[surface])
    low, high = np.full((len(anchor), 2), np.inf), np.full((len(anchor), 2), -np.inf)
    np.minimum.at(low, surface, along.min(axis=1))
    np.maximum.at(high, surface, along.max(axis=1))
    return low, high


def _lengths(vectors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def choose_layout(
    frames: SurfaceFrames,
    find_nodes: Callable[[GridLayout], Bools],
    max_nodes: int,
    *,
    distance_m: float = MIN_NODE_DISTANCE_M,
) -> tuple[GridLayout, Bools]:
    """Finest grids on which at most so many nodes are found, and the (h, w) mask of these."""
    while True:
        layout = lay_out(frames, distance_m)
        excess = layout.width * layout.height / _MAX_TEXELS
        if excess <= 1.0:
            nodes = find_nodes(layout)
            excess = float(np.count_nonzero(nodes)) / max_nodes
            # Grids of two by two nodes get no coarser.
            if excess <= 1.0 or distance_m > 100.0:
                return layout, nodes
        # The number of nodes falls with the square of their distance.
        distance_m *= max(1.1, float(np.sqrt(excess)))


def lay_out(frames: SurfaceFrames, node_distance_m: float) -> GridLayout:
    """Grids whose nodes are at most as far apart, packed into an atlas row by row."""
    columns, rows = (
        np.clip(np.ceil(_lengths(side) / node_distance_m) + 1, 2, _MAX_SIDE_NODES).astype(np.int32)
        for side in (frames.side_x, frames.side_y)
    )
    wide, high = (-(-columns // BLOCK) * BLOCK).tolist(), (-(-rows // BLOCK) * BLOCK).tolist()
    area = sum(w * h for w, h in zip(wide, high, strict=True))
    width = max(max(wide, default=BLOCK), BLOCK * int(np.ceil(np.sqrt(area) / BLOCK)))
    left, top = np.zeros_like(columns), np.zeros_like(rows)
    x = y = shelf = 0
    # Highest first: a shelf is as high as its first grid.
    for number in np.argsort(-rows, kind="stable").tolist():
        if x + wide[number] > width:
            x, y, shelf = 0, y + shelf, 0
        left[number], top[number] = x, y
        x, shelf = x + wide[number], max(shelf, high[number])
    grid = np.full((max(y + shelf, BLOCK), width), -1, dtype=np.int32)
    last = left + columns - 1, top + rows - 1
    index, number, _ = find_grid_nodes(np.stack((left, top, *last), axis=-1), width)
    grid.reshape(-1)[index] = number
    return GridLayout(columns, rows, left, top, width, len(grid), grid)


def place_nodes(frames: SurfaceFrames, layout: GridLayout, near: Bools) -> Nodes:
    """Nodes of a (h, w) mask, off their surfaces and the borders of these."""
    row, column = np.nonzero(near)
    patch = layout.grid[row, column].astype(np.intp)
    column, row = column - layout.left[patch], row - layout.top[patch]
    positions = frames.origin + _BIAS_M * frames.normal
    positions = positions[patch]
    for side, index, count in (
        (frames.side_x, column, layout.columns),
        (frames.side_y, row, layout.rows),
    ):
        inset = np.minimum(_INSET_M / np.linalg.norm(side, axis=-1), 0.1)[patch]
        along = np.clip(index / (count[patch] - 1), inset, 1.0 - inset)
        positions += along[:, None] * side[patch]
    ray_set = (row % 2 * 2 + column % 2).astype(np.intp)
    return Nodes(positions, patch, ray_set)


def find_atlas_rows(frames: SurfaceFrames, bounds: _Indices) -> tuple[Floats, Floats]:
    """(m, 4) rows that map world points to columns and to rows of the atlas."""
    first, spans = bounds[:, :2], bounds[:, 2:] - bounds[:, :2]
    sides = np.stack((frames.side_x, frames.side_y), axis=1)
    gram = einsum("mai,mbi->mab", sides, sides)
    dual = solve_linear(gram, sides) * spans[:, :, None]
    offset = first - einsum("mai,mi->ma", dual, frames.origin)
    rows = np.concatenate((dual, offset[:, :, None]), axis=-1)
    return np.ascontiguousarray(rows[:, 0]), np.ascontiguousarray(rows[:, 1])


def continue_grids(
    values: Floats,
    known: Bools,
    grid: npt.NDArray[np.int32],
    *,
    largest: float,
    otherwise: float,
) -> Floats:
    """Values, continued from known to unknown nodes of the grid, up to a largest."""
    for _ in range(_NUM_FILLED):
        row, column = np.nonzero(~known)
        total, count = np.zeros(len(row)), np.zeros(len(row))
        for dy, dx in _DIRECTIONS:
            near, is_near = _look(values, known, grid, (row, column), (dy, dx))
            far, is_far = _look(values, known, grid, (row, column), (2 * dy, 2 * dx))
            # Along a straight line: factors fall towards the foot of a wall.
            continued = np.clip(np.where(is_far, 2.0 * near - far, near), 0.0, largest)
            total += np.where(is_near, continued, 0.0)
            count += is_near
        filled = count > 0.0
        values, known = values.copy(), known.copy()
        values[row[filled], column[filled]] = total[filled] / count[filled]
        known[row[filled], column[filled]] = True
    return np.where(known, values, otherwise)


def _look(
    values: Floats,
    known: Bools,
    grid: npt.NDArray[np.int32],
    at: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    step: tuple[int, int],
) -> tuple[Floats, Bools]:
    """(k,) values a step away from nodes, and whether each is known and of the same grid."""
    y, x = (index + offset for index, offset in zip(at, step, strict=True))
    inside = (y >= 0) & (y < grid.shape[0]) & (x >= 0) & (x < grid.shape[1])
    y, x = np.where(inside, y, 0), np.where(inside, x, 0)
    return values[y, x], inside & known[y, x] & (grid[y, x] == grid[at])


def smooth_grids(values: Floats, layout: GridLayout) -> Floats:
    """Tent over three by three nodes of the grids; the outermost nodes count twice."""
    for axis, is_filtered in zip((1, 0), layout.is_filtered, strict=True):
        before, after = (_shift(values, layout.grid, axis, step) for step in (1, -1))
        # The last entry is for nodes without a grid.
        is_kept = ~np.append(is_filtered, False)[layout.grid]
        values = np.where(is_kept, values, 0.25 * (before + after) + 0.5 * values)
    return values


def _shift(values: Floats, grid: npt.NDArray[np.int32], axis: int, step: int) -> Floats:
    """Values of the nodes a step before each; the own value at the border of a grid."""
    is_same = np.roll(grid, step, axis=axis) == grid
    # Rolled round from the other border: a grid as wide as the atlas would meet itself.
    border = [slice(None), slice(None)]
    border[axis] = slice(0, 1) if step > 0 else slice(-1, None)
    is_same[tuple(border)] = False
    return np.where(is_same, np.roll(values, step, axis=axis), values)
