"""Ambient occlusion of a static scene: how much of the sky's light reaches each of its points.

Float64 reference of both renderers. Flat surfaces carry grids of factors, the nodes of which are
stored in one atlas of bytes and interpolated bilinearly; a factor scales hemisphere light alone.
Most triangles have no grid: nothing near occludes them, and their factor is exactly 1. Twins:
render/trace/kernel/src/occlusion.c and glsl/include/occlusion.glsl.
"""

from __future__ import annotations

from dataclasses import field

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass

# Bytes are factors: 255 is 1.
OPEN = 255
# Grids begin at multiples of this in the atlas, whose sides are multiples, too: blocks of nodes
# that belong to one grid.
BLOCK = 4


@dataclass(frozen=True, slots=True, eq=False)
class OcclusionMap:
    """Factors of hemisphere light on the surfaces of a scene."""

    patch_of: npt.NDArray[np.int32]
    """(n,) grid of each triangle; -1: nothing occludes it."""
    columns_from_world: Floats
    """(m, 4) for each grid: the atlas column of a point is the product with (x, y, z, 1)."""
    rows_from_world: Floats
    """(m, 4) likewise for the row."""
    bounds: npt.NDArray[np.int32]
    """(m, 4) first column, first row, last column, last row of each grid in the atlas."""
    texels: npt.NDArray[np.uint8]
    """(h, w) atlas."""
    darkest: npt.NDArray[np.uint8] = field(init=False)
    """(m,) smallest texel of each grid."""

    def __post_init__(self) -> None:
        """Find what is darkest on each grid, for bounds."""
        parts = (self.texels[t : b + 1, x : r + 1] for x, t, r, b in self.bounds.tolist())
        darkest = np.array([part.min() for part in parts], dtype=np.uint8)
        object.__setattr__(self, "darkest", darkest)
        for array in (self.patch_of, self.columns_from_world, self.rows_from_world, self.bounds):
            array.setflags(write=False)
        self.texels.setflags(write=False)

    @property
    def arrays(self) -> tuple[npt.NDArray[np.generic], ...]:
        """All that a map is made of."""
        rows = self.columns_from_world, self.rows_from_world
        return (self.patch_of, *rows, self.bounds, self.texels)

    def atlas_positions(self, triangles: npt.NDArray[np.integer], points: Floats) -> Floats:
        """(n, 2) columns and rows of (n, 3) points on triangles that have grids."""
        patch = self.patch_of[triangles]
        frames = np.stack((self.columns_from_world[patch], self.rows_from_world[patch]), axis=1)
        positions: Floats = np.einsum("nki,ni->nk", frames[..., :3], points) + frames[..., 3]
        bounds = self.bounds[patch]
        # A point beside the outermost nodes, by rounding or near an edge, has the nodes' factor.
        return np.clip(positions, bounds[:, :2], bounds[:, 2:])

    def factors(self, triangles: npt.NDArray[np.integer], points: Floats) -> Floats:
        """(n,) factors of hemisphere light at (n, 3) points of triangles, world frame."""
        factors = np.ones(len(points))
        inside = np.flatnonzero(self.patch_of[triangles] >= 0)
        positions = self.atlas_positions(triangles[inside], points[inside])
        first = np.floor(positions).astype(np.intp)
        fx, fy = (positions - first).T
        # In the last column and row both nodes are the same.
        last = self.bounds[self.patch_of[triangles[inside]], 2:]
        (xa, ya), (xb, yb) = first.T, np.minimum(first + 1, last).T
        texels = self.texels
        upper = (1.0 - fx) * texels[ya, xa] + fx * texels[ya, xb]
        lower = (1.0 - fx) * texels[yb, xa] + fx * texels[yb, xb]
        factors[inside] = ((1.0 - fy) * upper + fy * lower) / OPEN
        return factors

    def smallest_factors(self, triangles: slice = slice(None)) -> Floats:
        """(k,) smallest factor of any point of each of some triangles."""
        patch = self.patch_of[triangles]
        darkest = np.append(self.darkest, np.uint8(OPEN))
        smallest: Floats = darkest[patch] / OPEN
        return smallest
