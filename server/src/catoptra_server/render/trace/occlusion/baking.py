"""The occlusion map of a scene: rays from the nodes of its surfaces' grids.

Rays meet the triangles that occlude lights. A node inside a solid, which nobody sees, takes its
neighbours' factors: a floor goes on below a crate, and interpolation would darken the floor beside
it. Factors are bytes, so the last bits of rays hardly show.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.kernel.flat_surfaces import find_flat_surfaces
from catoptra_server.render.trace.occlusion.factor_filter import filter_factors
from catoptra_server.render.trace.occlusion.grid_layout import (
    GridLayout,
    SurfaceFrames,
    frame_surfaces,
    lay_out,
)
from catoptra_server.render.trace.occlusion.near_nodes import enclose_casters, find_near_pairs
from catoptra_server.render.trace.occlusion.sky_rays import (
    RADIUS_M,
    occluder_weights,
    sky_directions,
)
from catoptra_server.world.occlusion_map import OPEN, OcclusionMap
from catoptra_server.world.scene_mesh import SceneMesh

# Nodes near casters: 32 rays each take 0.1 to 0.2 s on two processors.
MAX_NEAR_NODES = 48_000
MAX_TEXELS = 2_000_000
# Between nodes: fine enough for the foot of a goal post.
MIN_NODE_DISTANCE_M = 0.05
# Rays start before their surface: above markings on a floor, which occlude nothing, and off the
# border, where another surface begins.
_BIAS_M = 0.003
_INSET_M = 0.005
# Rays of which more than this share meet back faces within the radius start inside a solid, or on
# its side: a node at the foot of a wall sees half of its rays inside.
_INSIDE_SHARE = 0.1
_NODES_AT_ONCE = 2000


class TriangleCaster(Protocol):
    """First hits of rays; `ray_caster.SceneRayCaster`."""

    def closest_triangles(
        self, origins: Floats, directions: Floats
    ) -> tuple[Floats, npt.NDArray[np.int32]]:
        """(n,) distances and triangles; infinite and -1 without a hit."""


def bake_occlusion(
    scene: SceneMesh, caster: TriangleCaster, *, threads: int
) -> OcclusionMap | None:
    """Occlusion map of a scene; None where nothing is occluded.

    Args:
        scene: Triangles, fewer than flat_surfaces.MAX_TRIANGLES.
        caster: Rays in the same triangles; called from several threads at once.
        threads: Threads; the result is the same for any number.
    """
    frames = frame_surfaces(scene, find_flat_surfaces(scene))
    layout, near = _choose_layout(scene, frames)
    nodes = _place_nodes(frames, layout, near)
    factors, inside = _measure_all(scene, caster, nodes, threads)
    texels = filter_factors(layout, near, factors, inside)
    return _without_open_grids(frames, layout, texels)


def _choose_layout(scene: SceneMesh, frames: SurfaceFrames) -> tuple[GridLayout, Bools]:
    """Finest grids that are not too many nodes, and the nodes near casters."""
    boxes = enclose_casters(scene.corners[scene.casts_shadows])
    pairs = find_near_pairs(frames, boxes, RADIUS_M)
    distance_m = MIN_NODE_DISTANCE_M
    while True:
        layout = lay_out(frames, distance_m)
        size = layout.width * layout.height
        if size <= MAX_TEXELS:
            near = pairs.find_nodes(layout)
            excess = float(np.count_nonzero(near)) / MAX_NEAR_NODES
            # Grids of two by two nodes get no coarser.
            if excess <= 1.0 or distance_m > 100.0:
                return layout, near
        else:
            excess = size / MAX_TEXELS
        distance_m *= max(1.1, float(np.sqrt(excess)))


@dataclass(frozen=True, slots=True, eq=False)
class _Nodes:
    """Nodes to be measured."""

    positions: Floats
    """(k, 3) before their surfaces, metres."""
    patch: npt.NDArray[np.intp]
    """(k,) surface of each."""
    ray_set: npt.NDArray[np.intp]
    """(k,) set of directions."""
    directions: npt.NDArray[np.float32]
    """(m, sets, rays, 3) directions of each surface."""


def _place_nodes(frames: SurfaceFrames, layout: GridLayout, near: Bools) -> _Nodes:
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
    return _Nodes(positions, patch, ray_set, _turn_directions(frames))


def _turn_directions(frames: SurfaceFrames) -> npt.NDArray[np.float32]:
    """(m, sets, rays, 3) directions around each surface's normal."""
    axis_x = frames.side_x / np.linalg.norm(frames.side_x, axis=-1, keepdims=True)
    axis_y = np.cross(frames.normal, axis_x)
    axes = np.stack((axis_x, axis_y, frames.normal), axis=1).astype(np.float32)
    directions = sky_directions().astype(np.float32)
    return np.asarray(directions.reshape(1, -1, 3) @ axes).reshape(-1, *directions.shape)


def _measure_all(
    scene: SceneMesh, caster: TriangleCaster, nodes: _Nodes, threads: int
) -> tuple[Floats, Bools]:
    """(k,) factors of nodes, and whether each lies inside a solid."""
    count = len(nodes.patch)
    factors, inside = np.ones(count), np.zeros(count, dtype=bool)
    normals = scene.normals.astype(np.float32)

    def measure(first: int) -> None:
        part = slice(first, first + _NODES_AT_ONCE)
        directions = nodes.directions[nodes.patch[part], nodes.ray_set[part]]
        rays = directions.shape[:2]
        origins = np.repeat(nodes.positions[part], rays[1], axis=0)
        flat = directions.reshape(-1, 3)
        distances, triangles = caster.closest_triangles(origins, flat.astype(np.float64))
        is_hit = triangles >= 0
        is_back = is_hit & (distances < RADIUS_M)
        is_back &= np.einsum("ri,ri->r", normals[triangles], flat) > 0.0
        weights = occluder_weights(distances) * (is_hit & scene.casts_shadows[triangles])
        factors[part] = 1.0 - weights.reshape(rays).mean(axis=1)
        inside[part] = is_back.reshape(rays).mean(axis=1) > _INSIDE_SHARE

    with ThreadPoolExecutor(max(1, threads), thread_name_prefix="occlusion") as pool:
        # list() waits for all and raises the first error of any; each writes rows of its own.
        list(pool.map(measure, range(0, count, _NODES_AT_ONCE)))
    return factors, inside


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
    columns, rows = _find_atlas_rows(kept, bounds[:, :2], bounds[:, 2:] - bounds[:, :2])
    return OcclusionMap(kept.patch_of, columns, rows, bounds, texels)


def _find_atlas_rows(
    frames: SurfaceFrames, first: npt.NDArray[np.int32], spans: npt.NDArray[np.int32]
) -> tuple[Floats, Floats]:
    """(m, 4) rows that map world points to columns and to rows of the atlas."""
    sides = np.stack((frames.side_x, frames.side_y), axis=1)
    gram = np.einsum("mai,mbi->mab", sides, sides)
    dual = np.linalg.solve(gram, sides) * spans[:, :, None]
    offset = first - np.einsum("mai,mi->ma", dual, frames.origin)
    rows = np.concatenate((dual, offset[:, :, None]), axis=-1)
    return np.ascontiguousarray(rows[:, 0]), np.ascontiguousarray(rows[:, 1])
