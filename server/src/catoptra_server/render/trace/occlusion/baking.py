"""The occlusion map of a scene: rays from the nodes of grids over its surfaces.

A point's factor is 1 less the mean weight over the hemisphere of its normal: 1 - (1 / pi) integral
of cos(theta) weight(distance(direction)). An occluder at distance 0 has the weight 1, so a point at
the foot of an infinite wall has the factor 1/2; weights fall to 0 at the radius, since in a closed
room every direction ends on something. Source: Zhukov et al. 1998, "An ambient light illumination
model".

Five steps, in the order of this file. Flat surfaces get grids of nodes over their bounding
rectangles, the outermost nodes on the border; triangles of no flat surface get two by two nodes,
where there are many of them neighbours of like direction together. Only nodes near boxes around
casters are measured. Neighbouring nodes use different sets of directions, in squares of two by two.
A node inside a solid, which nobody sees, takes its neighbours' factors: a floor goes on below a
crate, and interpolation would darken the floor beside it. A tent over three by three nodes then
weighs all four sets alike, so that steps at the edges of occluders vanish. Factors are bytes, so
the last bits of rays hardly show.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import cos, dot, einsum, matmul, sin, solve_linear
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
from catoptra_server.world.shading import BLOCK, OPEN, OcclusionMap
from catoptra_server.world.triangles import make_clusters

if TYPE_CHECKING:
    from catoptra_server.render.trace.ray_caster import SceneRayCaster

# Beyond, nothing occludes: the size of things that stand on floors. Chosen by pictures of the
# field, the corridor and the rescue world.
RADIUS_M = 0.5
# Sets of directions, one for each node of a square of four nodes; a filter then mixes all of them.
NUM_SETS = 4
RAYS_PER_NODE = 32
# Nodes near casters: 32 rays each take 0.1 to 0.2 s on two processors.
_MAX_NEAR_NODES = 48_000
# A byte each, on the device as well.
_MAX_TEXELS = 2_000_000
# Between nodes: fine enough for the foot of a goal post.
_MIN_NODE_DISTANCE_M = 0.05
# Nodes along a side, whatever the surface's size: OpenGL 3.3 guarantees textures of 1024 texels.
_MAX_SIDE_NODES = 1000
# Grids of whole surfaces, the largest; each is compared with each box of casters.
_MAX_SURFACES = 4000
# Of triangles of no flat surface: four nodes each, of the 48 000 that are measured.
_MAX_SMALL_GRIDS = 8000
# Between triangles that share a grid: the components of their normals beyond a third agree in sign.
_DIRECTIONS_PER_UNIT = 3.0
# Lower things occlude nothing of a plane: markings lie on floors, posters on walls.
_MIN_HEIGHT_M = 0.005
# Boxes in all, at least; a scene of few triangles has one each.
_NUM_BOXES = 500
_SURFACES_AT_ONCE = 256
# Rays start before their surface: above markings on a floor, which occlude nothing, and off the
# border, where another surface begins.
_BIAS_M = 0.003
_INSET_M = 0.005
# Rays of which more than this share meet back faces within the radius start inside a solid, or on
# its side: at the foot of a wall half of a node's rays are inside.
_INSIDE_SHARE = 0.1
# 64 000 rays: enough for each call, few enough to share among threads.
_NODES_AT_ONCE = 2000
# Rows of nodes inside a solid that the filter or an interpolation near a visible node reaches.
_NUM_FILLED = 2
# Shorter sides are left as they are: the tent would level their only steps.
_MIN_FILTERED = 4
_DIRECTIONS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]
_Indices = npt.NDArray[np.int32]
_Numbers = npt.NDArray[np.intp]


def bake_occlusion(
    scene: SceneMesh, caster: SceneRayCaster, *, threads: int
) -> OcclusionMap | None:
    """Occlusion map of a scene; None where nothing is occluded.

    Args:
        scene: Triangles.
        caster: Rays in the same triangles; called from several threads at once.
        threads: Threads; the result is the same for any number.
    """
    frames = frame_surfaces(scene, threads=threads)
    layout, near = _choose_layout(scene, frames)
    nodes = place_nodes(frames, layout, near)
    factors, inside = _measure_all(scene, caster, nodes, _turn_directions(frames), threads)
    texels = filter_factors(layout, near, factors, inside)
    return _without_open_grids(frames, layout, texels)


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


def _choose_layout(scene: SceneMesh, frames: SurfaceFrames) -> tuple[GridLayout, Bools]:
    """Finest grids that are not too many nodes, and the nodes near casters."""
    boxes = _enclose_casters(scene.corners[scene.casts_shadows])
    pairs = _find_near_pairs(frames, boxes)
    distance_m = _MIN_NODE_DISTANCE_M
    while True:
        layout = lay_out(frames, distance_m)
        size = layout.width * layout.height
        if size <= _MAX_TEXELS:
            near = pairs.find_nodes(layout)
            excess = float(np.count_nonzero(near)) / _MAX_NEAR_NODES
            # Grids of two by two nodes get no coarser.
            if excess <= 1.0 or distance_m > 100.0:
                return layout, near
        else:
            excess = size / _MAX_TEXELS
        # The number of nodes falls with the square of their distance.
        distance_m *= max(1.1, float(np.sqrt(excess)))


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
        return SurfaceFrames(
            self.patch_of,
            self.origin[surfaces],
            self.side_x[surfaces],
            self.side_y[surfaces],
            self.normal[surfaces],
        )

    def transpose(self) -> SurfaceFrames:
        """Surfaces with their sides exchanged."""
        return replace(self, side_x=self.side_y, side_y=self.side_x)


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
    frames = SurfaceFrames(
        patch_of,
        np.concatenate((large.origin, joined.origin)),
        np.concatenate((large.side_x, joined.side_x)),
        np.concatenate((large.side_y, joined.side_y)),
        np.concatenate((large.normal, joined.normal)),
    )
    # Unlit surfaces show their albedo; one without an area has no plane.
    is_lit = np.concatenate((~scene.unlit[representative], np.ones(len(middle), dtype=bool)))
    has_area = (_lengths(frames.side_x) > 0.0) & (_lengths(frames.side_y) > 0.0)
    return frames.take(np.flatnonzero(is_lit & has_area & frames.normal.any(axis=-1)))


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

    def grid_at(self) -> _Indices:
        """(h, w) number of the grid that each node of the atlas belongs to; -1 for none."""
        grid = np.full((self.height, self.width), -1, dtype=np.int32)
        corners = np.stack((self.left, self.top, self.columns, self.rows), axis=-1)
        for number, (x, y, w, h) in enumerate(corners.tolist()):
            grid[y : y + h, x : x + w] = number
        return grid

    def bounds(self) -> _Indices:
        """(m, 4) first column, first row, last column, last row of each grid."""
        last = self.left + self.columns - 1, self.top + self.rows - 1
        return np.stack((self.left, self.top, *last), axis=-1).astype(np.int32)


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
    return GridLayout(columns, rows, left, top, width, max(y + shelf, BLOCK))


@dataclass(frozen=True, slots=True, eq=False)
class _CasterBoxes:
    """Boxes around all triangles that occlude light."""

    centre: Floats
    """(b, 3) metres."""
    half: Floats
    """(b, 3) half sizes."""

    def take(self, boxes: _Numbers) -> _CasterBoxes:
        """Rows of some boxes."""
        return _CasterBoxes(self.centre[boxes], self.half[boxes])


def _enclose_casters(corners: Floats) -> _CasterBoxes:
    """Boxes around (n, 3, 3) triangles: neighbours of like size share one."""
    longest = np.ptp(corners, axis=1).max(axis=-1, initial=0.0)
    # A floor shares no box with a crate on it.
    size_class = np.frexp(np.maximum(longest, 1e-3) * 1e3)[1].astype(np.intp)
    clusters = make_clusters(corners, size_class, size=max(1, len(corners) // _NUM_BOXES))
    return _CasterBoxes(clusters.centres, clusters.half_sizes)


@dataclass(frozen=True, slots=True, eq=False)
class _NearPairs:
    """Surfaces, and the boxes of casters near each."""

    surface: _Numbers
    """(p,) surface of each pair."""
    frames: SurfaceFrames
    """Coordinate system of that surface."""
    boxes: _CasterBoxes
    """The box of each pair."""

    def find_nodes(self, layout: GridLayout) -> Bools:
        """(h, w) nodes of an atlas that have a box within the radius."""
        x0, x1 = self._find_span(self.frames, layout.columns[self.surface])
        y0, y1 = self._find_span(self.frames.transpose(), layout.rows[self.surface])
        is_met = (x0 < x1) & (y0 < y1)
        left, top = layout.left[self.surface], layout.top[self.surface]
        x0, x1, y0, y1 = (a[is_met] for a in (left + x0, left + x1, top + y0, top + y1))
        # Corners of rectangles, summed along both axes, count the rectangles over each node.
        count = np.zeros((layout.height + 1, layout.width + 1), dtype=np.int32)
        for rows, columns, sign in ((y0, x0, 1), (y0, x1, -1), (y1, x0, -1), (y1, x1, 1)):
            np.add.at(count, (rows, columns), sign)
        near: Bools = count.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0
        return near

    def _find_span(
        self, frames: SurfaceFrames, num_nodes: npt.NDArray[np.int32]
    ) -> tuple[_Numbers, _Numbers]:
        """First node along side x within the radius of each box, and the one after the last."""
        length = _lengths(frames.side_x)
        axis = frames.side_x / length[:, None]
        centre = einsum("pi,pi->p", self.boxes.centre - frames.origin, axis)
        half = einsum("pi,pi->p", self.boxes.half, np.abs(axis)) + RADIUS_M
        # The sides of small triangles' grids enclose any angle.
        half += np.abs(einsum("pi,pi->p", frames.side_y, axis))
        step = length / (num_nodes - 1)
        # Whole steps outward: bilinear interpolation reaches there.
        first = np.floor((centre - half) / step).astype(np.intp)
        last = np.ceil((centre + half) / step).astype(np.intp)
        return np.maximum(first, 0), np.minimum(last + 1, num_nodes)


def _find_near_pairs(frames: SurfaceFrames, boxes: _CasterBoxes) -> _NearPairs:
    """Boxes that reach before the planes of surfaces and near their rectangles."""
    middle = frames.origin + 0.5 * (frames.side_x + frames.side_y)
    diagonals = np.stack((frames.side_x + frames.side_y, frames.side_x - frames.side_y))
    limit = 0.5 * np.linalg.norm(diagonals, axis=-1).max(axis=0) + RADIUS_M
    pairs = [(np.zeros(0, dtype=np.intp),) * 2]
    # In parts: 4000 surfaces and 500 boxes would take 48 MB in each array of vectors.
    for first in range(0, len(middle) if len(boxes.half) else 0, _SURFACES_AT_ONCE):
        part = slice(first, first + _SURFACES_AT_ONCE)
        offset = boxes.centre - middle[part, None]
        outside = np.maximum(np.abs(offset) - boxes.half, 0.0)
        squared = einsum("mbi,mbi->mb", outside, outside)
        near = squared < limit[part, None] ** 2
        height = einsum("mbi,mi->mb", offset, frames.normal[part])
        reach = matmul(np.abs(frames.normal[part]), boxes.half.T)
        near &= (height + reach > _MIN_HEIGHT_M) & (height - reach < RADIUS_M)
        # Where the nearest box is within the radius of all nodes, no other adds one.
        squared[~near] = np.inf
        nearest = squared.argmin(axis=1)
        reserve = np.maximum(2.0 * RADIUS_M - limit[part], 0.0)
        is_whole = np.flatnonzero(squared.min(axis=1, initial=np.inf) < np.square(reserve))
        near[is_whole] = False
        near[is_whole, nearest[is_whole]] = True
        surface, box = np.nonzero(near)
        pairs.append((surface + first, box))
    surface, box = (np.concatenate(found) for found in zip(*pairs, strict=True))
    return _NearPairs(surface, frames.take_rows(surface), boxes.take(box))


@dataclass(frozen=True, slots=True, eq=False)
class _Nodes:
    """Nodes to be measured."""

    positions: Floats
    """(k, 3) before their surfaces, metres."""
    patch: npt.NDArray[np.intp]
    """(k,) surface of each."""
    ray_set: npt.NDArray[np.intp]
    """(k,) set of directions."""


def place_nodes(frames: SurfaceFrames, layout: GridLayout, near: Bools) -> _Nodes:
    row, column = np.nonzero(near)
    patch = layout.grid_at()[row, column].astype(np.intp)
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
    return _Nodes(positions, patch, ray_set)


def _turn_directions(frames: SurfaceFrames) -> npt.NDArray[np.float32]:
    """(m, sets, rays, 3) directions around each surface's normal."""
    axis_x = frames.side_x / np.linalg.norm(frames.side_x, axis=-1, keepdims=True)
    axis_y = np.cross(frames.normal, axis_x)
    axes = np.stack((axis_x, axis_y, frames.normal), axis=1).astype(np.float32)
    directions = _sky_directions().astype(np.float32)
    return np.asarray(matmul(directions.reshape(1, -1, 3), axes)).reshape(-1, *directions.shape)


def _sky_directions() -> Floats:
    """(NUM_SETS, RAYS_PER_NODE, 3) unit directions around z, distributed by the cosine.

    Sobol's first two dimensions: each block of a power of two points is stratified by itself, and
    all blocks together are, too.
    """
    across, around = sobol_points(NUM_SETS * RAYS_PER_NODE)
    around = 2.0 * np.pi * around
    radius = np.sqrt(across)
    directions = np.stack(
        (radius * cos(around), radius * sin(around), np.sqrt(1.0 - across)), axis=-1
    )
    return directions.reshape(NUM_SETS, RAYS_PER_NODE, 3)


def sobol_points(count: int) -> tuple[Floats, Floats]:
    """(count,) points of Sobol's first two dimensions in [0, 1), half a cell off the borders."""
    # No ray along the surface, none along its normal.
    # The first dimension is van der Corput's sequence, the second that of the polynomial x + 1.
    halves = [1 << bit for bit in range(15, -1, -1)]
    columns = [1 << 15]
    for _ in range(15):
        columns.append(columns[-1] ^ columns[-1] >> 1)
    across = (_digital_sequence(count, halves) + 0.5 / count) % 1.0
    return across, _digital_sequence(count, columns) + 0.5 / count


def _digital_sequence(count: int, columns: list[int]) -> Floats:
    """(count,) exclusive sums of 16-bit columns, as fractions, by the bits of the index."""
    index = np.arange(count)
    total = np.zeros(count, dtype=np.int64)
    for bit, column in enumerate(columns):
        total ^= np.where(index >> bit & 1, column, 0)
    return total / 65536.0


def _measure_all(
    scene: SceneMesh,
    caster: SceneRayCaster,
    nodes: _Nodes,
    directions_of: npt.NDArray[np.float32],
    threads: int,
) -> tuple[Floats, Bools]:
    """(k,) factors of nodes, and whether each is in a solid; `directions_of` surfaces by sets."""
    count = len(nodes.patch)
    factors, inside = np.ones(count), np.zeros(count, dtype=bool)
    normals = scene.normals.astype(np.float32)

    def measure(first: int) -> None:
        part = slice(first, first + _NODES_AT_ONCE)
        directions = directions_of[nodes.patch[part], nodes.ray_set[part]]
        rays = directions.shape[:2]
        origins = np.repeat(nodes.positions[part], rays[1], axis=0)
        flat = directions.reshape(-1, 3)
        distances, triangles = caster.closest_triangles(origins, flat.astype(np.float64))
        is_hit = triangles >= 0
        is_back = is_hit & (distances < RADIUS_M)
        is_back &= einsum("ri,ri->r", normals[triangles], flat) > 0.0
        # A thing that casts no shadow stops the ray and hides nothing.
        weights = occluder_weights(distances) * (is_hit & scene.casts_shadows[triangles])
        factors[part] = 1.0 - weights.reshape(rays).mean(axis=1)
        inside[part] = is_back.reshape(rays).mean(axis=1) > _INSIDE_SHARE

    with ThreadPoolExecutor(max(1, threads), thread_name_prefix="occlusion") as pool:
        # list() waits for all and raises the first error of any; no two write the same rows.
        list(pool.map(measure, range(0, count, _NODES_AT_ONCE)))
    return factors, inside


def occluder_weights(distances: Floats) -> Floats:
    """Weights of occluders at distances, metres: 1 at distance 0, 0 from the radius on."""
    nearness = np.maximum(1.0 - distances / RADIUS_M, 0.0)
    weights: Floats = nearness * nearness
    return weights


def filter_factors(
    layout: GridLayout, near: Bools, factors: Floats, inside: Bools
) -> npt.NDArray[np.uint8]:
    """(h, w) atlas of the factors of the nodes that are near casters, in their order; else open.

    Args:
        layout: Places of the grids.
        near: (h, w) nodes that were measured.
        factors: (k,) factors of these.
        inside: (k,) nodes inside solids.
    """
    values, known = np.ones(near.shape), np.ones(near.shape, dtype=bool)
    values[near], known[near] = factors, ~inside
    grid = layout.grid_at()
    values = continue_grids(values, known, grid, largest=1.0, otherwise=1.0)
    values = blur(values, grid, axis=1, is_filtered=layout.columns >= _MIN_FILTERED)
    values = blur(values, grid, axis=0, is_filtered=layout.rows >= _MIN_FILTERED)
    return np.round(values * OPEN).astype(np.uint8)


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


def blur(values: Floats, grid: npt.NDArray[np.int32], *, axis: int, is_filtered: Bools) -> Floats:
    """Tent over three nodes along an axis of the grids; the outermost nodes count twice."""
    before, after = _shift(values, grid, axis, 1), _shift(values, grid, axis, -1)
    # The last entry is for nodes without a grid.
    is_kept = ~np.append(is_filtered, False)[grid]
    return np.where(is_kept, values, 0.25 * (before + after) + 0.5 * values)


def _shift(values: Floats, grid: npt.NDArray[np.int32], axis: int, step: int) -> Floats:
    """Values of the nodes a step before each; the own value at the border of a grid."""
    is_same = np.roll(grid, step, axis=axis) == grid
    # Rolled round from the other border: a grid as wide as the atlas would meet itself.
    border = [slice(None), slice(None)]
    border[axis] = slice(0, 1) if step > 0 else slice(-1, None)
    is_same[tuple(border)] = False
    return np.where(is_same, np.roll(values, step, axis=axis), values)


def _without_open_grids(
    frames: SurfaceFrames, layout: GridLayout, texels: npt.NDArray[np.uint8]
) -> OcclusionMap | None:
    """Map of the grids that some factor makes darker."""
    bounds = layout.bounds()
    is_dark = [texels[t : b + 1, x : r + 1].min() < OPEN for x, t, r, b in bounds.tolist()]
    dark = np.flatnonzero(np.array(is_dark, dtype=bool))
    if not len(dark):
        return None
    kept, bounds = frames.take(dark), bounds[dark]
    columns, rows = find_atlas_rows(kept, bounds[:, :2], bounds[:, 2:] - bounds[:, :2])
    return OcclusionMap(kept.patch_of, columns, rows, bounds, texels)


def find_atlas_rows(
    frames: SurfaceFrames, first: npt.NDArray[np.int32], spans: npt.NDArray[np.int32]
) -> tuple[Floats, Floats]:
    """(m, 4) rows that map world points to columns and to rows of the atlas."""
    sides = np.stack((frames.side_x, frames.side_y), axis=1)
    gram = einsum("mai,mbi->mab", sides, sides)
    dual = solve_linear(gram, sides) * spans[:, :, None]
    offset = first - einsum("mai,mi->ma", dual, frames.origin)
    rows = np.concatenate((dual, offset[:, :, None]), axis=-1)
    return np.ascontiguousarray(rows[:, 0]), np.ascontiguousarray(rows[:, 1])
