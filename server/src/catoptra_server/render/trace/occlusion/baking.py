"""The occlusion map of a scene: rays from the nodes of grids over its surfaces.

A point's factor is 1 less the mean weight over the hemisphere of its normal: 1 - (1 / pi) integral
of cos(theta) weight(distance(direction)). An occluder at distance 0 has the weight 1, so a point at
the foot of an infinite wall has the factor 1/2; weights fall to 0 at the radius, since in a closed
room every direction ends on something. Source: Zhukov et al. 1998, "An ambient light illumination
model".

Only nodes near boxes around casters are measured. Neighbouring nodes use different sets of
directions, in squares of two by two. A tent over three by three nodes then weighs all four sets
alike, so that steps at the edges of occluders vanish. Factors are bytes, so the last bits of rays
hardly show.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import cos, einsum, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.occlusion.surface_grids import (
    GridLayout,
    Nodes,
    SurfaceFrames,
    choose_layout,
    continue_grids,
    find_atlas_rows,
    frame_surfaces,
    place_nodes,
    smooth_grids,
)
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import OPEN, OcclusionMap, find_grid_nodes
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
# Lower things occlude nothing of a plane: markings lie on floors, posters on walls.
_MIN_HEIGHT_M = 0.005
# Boxes in all, at least; a scene of few triangles has one each.
_NUM_BOXES = 500
_SURFACES_AT_ONCE = 256
# Rays of which more than this share meet back faces within the radius start inside a solid, or on
# its side: at the foot of a wall half of a node's rays are inside.
_INSIDE_SHARE = 0.1
# 64 000 rays: enough for each call, few enough to share among threads.
_NODES_AT_ONCE = 2000
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
    pairs = _find_near_pairs(frames, _enclose_casters(scene.corners[scene.casts_shadows]))
    layout, near = choose_layout(frames, pairs.find_nodes, _MAX_NEAR_NODES)
    nodes = place_nodes(frames, layout, near)
    factors, inside = _measure_all(scene, caster, nodes, _turn_directions(frames), threads)
    texels = filter_factors(layout, near, factors, inside)
    return _without_open_grids(frames, layout, texels)


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
        length = np.linalg.norm(frames.side_x, axis=-1)
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
    nodes: Nodes,
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
    values = continue_grids(values, known, layout.grid, largest=1.0, otherwise=1.0)
    return np.round(smooth_grids(values, layout) * OPEN).astype(np.uint8)


def _without_open_grids(
    frames: SurfaceFrames, layout: GridLayout, texels: npt.NDArray[np.uint8]
) -> OcclusionMap | None:
    """Map of the grids that some factor makes darker."""
    bounds = layout.bounds()
    index, _, first = find_grid_nodes(bounds, layout.width)
    dark = np.flatnonzero(np.minimum.reduceat(texels.reshape(-1)[index], first) < OPEN)
    if not len(dark):
        return None
    kept, bounds = frames.take(dark), bounds[dark]
    return OcclusionMap(kept.patch_of, *find_atlas_rows(kept, bounds), bounds, texels)
