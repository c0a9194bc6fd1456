"""Grids of nodes over the flat surfaces of a scene, packed into one atlas.

Nodes lie on a surface's bounding rectangle in its plane, the outermost on its border, so that two
nodes a side are the least. Triangles that belong to no flat surface (of worlds with very many) have
a grid of two by two nodes each, between their corners, if they are few enough.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.kernel.flat_surfaces import FlatSurfaces
from catoptra_server.world.occlusion_map import BLOCK
from catoptra_server.world.scene_mesh import SceneMesh

Indices = npt.NDArray[np.int32]

# Nodes along a side, whatever the surface's size: OpenGL 3.3 guarantees textures of 1024 texels.
_MAX_SIDE_NODES = 1000
_MAX_SMALL_TRIANGLES = 8000


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFrames:
    """Coordinate systems of m surfaces: point = origin + s side_x + t side_y, s and t in [0, 1]."""

    patch_of: Indices
    """(n,) surface of each triangle, -1 for none."""
    origin: Floats
    """(m, 3) corner of the rectangle, world frame, metres."""
    side_x: Floats
    """(m, 3) one side of it."""
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


@dataclass(frozen=True, slots=True, eq=False)
class GridLayout:
    """Places of m grids in an atlas."""

    columns: Indices
    """(m,) nodes along side x, at least 2."""
    rows: Indices
    """(m,) nodes along side y, at least 2."""
    left: Indices
    """(m,) first column in the atlas."""
    top: Indices
    """(m,) first row."""
    width: int
    """Columns of the atlas."""
    height: int
    """Rows of the atlas."""

    def grid_at(self) -> Indices:
        """(h, w) number of the grid that each node of the atlas belongs to; -1 for none."""
        grid = np.full((self.height, self.width), -1, dtype=np.int32)
        corners = np.stack((self.left, self.top, self.columns, self.rows), axis=-1)
        for number, (x, y, w, h) in enumerate(corners.tolist()):
            grid[y : y + h, x : x + w] = number
        return grid

    def bounds(self) -> Indices:
        """(m, 4) first column, first row, last column, last row of each grid."""
        last = self.left + self.columns - 1, self.top + self.rows - 1
        return np.stack((self.left, self.top, *last), axis=-1).astype(np.int32)


def frame_surfaces(scene: SceneMesh, flat: FlatSurfaces) -> SurfaceFrames:
    """Coordinate systems of the lit surfaces of a scene."""
    patch_of = np.full(len(scene), -1, dtype=np.int32)
    patch_of[flat.triangles] = flat.surface
    large = _frame_large(scene, flat)
    small = np.flatnonzero((patch_of < 0) & ~scene.unlit)
    if len(small) > _MAX_SMALL_TRIANGLES:
        small = small[:0]
    patch_of[small] = len(flat.representative) + np.arange(len(small), dtype=np.int32)
    first, second, third = np.moveaxis(scene.corners[small], 1, 0)
    frames = SurfaceFrames(
        patch_of,
        np.concatenate((large.origin, first)),
        np.concatenate((large.side_x, second - first)),
        np.concatenate((large.side_y, third - first)),
        np.concatenate((large.normal, scene.normals[small])),
    )
    # Unlit surfaces show their albedo; one without an area has no plane.
    is_lit = np.concatenate((~scene.unlit[flat.representative], np.ones(len(small), dtype=bool)))
    has_area = (_lengths(frames.side_x) > 0.0) & (_lengths(frames.side_y) > 0.0)
    return frames.take(np.flatnonzero(is_lit & has_area & frames.normal.any(axis=-1)))


def _frame_large(scene: SceneMesh, flat: FlatSurfaces) -> SurfaceFrames:
    """Bounding rectangles of flat surfaces along axes of their planes."""
    normal = scene.normals[flat.representative]
    # The horizontal tangent, so that rows of nodes follow floors along walls; on a floor, the
    # world's x axis.
    horizontal = np.cross(np.array([0.0, 0.0, 1.0]), normal)
    is_level = _lengths(horizontal) < 1e-3
    axis_x = np.where(is_level[:, None], np.array([1.0, 0.0, 0.0]), horizontal)
    axis_x -= np.einsum("mi,mi->m", axis_x, normal)[:, None] * normal
    axis_x /= np.maximum(_lengths(axis_x), 1e-12)[:, None]
    axis_y = np.cross(normal, axis_x)
    corners = scene.corners[flat.triangles]
    anchor = scene.corners[flat.representative, 0]
    low, high = _extents(corners, anchor, np.stack((axis_x, axis_y), axis=1), flat.surface)
    return SurfaceFrames(
        flat.surface,
        anchor + low[:, :1] * axis_x + low[:, 1:] * axis_y,
        (high - low)[:, :1] * axis_x,
        (high - low)[:, 1:] * axis_y,
        normal,
    )


def _extents(
    corners: Floats, anchor: Floats, axes: Floats, surface: Indices
) -> tuple[Floats, Floats]:
    """(m, 2) least and largest coordinates of the triangles of each surface along its axes."""
    from_anchor = corners - anchor[surface][:, None]
    along = np.einsum("tci,tki->tck", from_anchor, axes[surface])
    low, high = np.full((len(anchor), 2), np.inf), np.full((len(anchor), 2), -np.inf)
    np.minimum.at(low, surface, along.min(axis=1))
    np.maximum.at(high, surface, along.max(axis=1))
    return low, high


def _lengths(vectors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


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
