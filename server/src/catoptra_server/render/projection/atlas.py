"""Where the parts of the cube's faces lie in one texture, and how each is projected there.

Knows no GL. One 2-D texture instead of a cube map: every part is drawn a few texels wider than it
is seen, so that bilinear look-ups never cross a border and no seam exists; and only what the mirror
looks into has texels at all, as many as the plan gives it. Row 0 of the texture is the top of every
part.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.planning.face_regions import FaceRegion

# A bilinear look-up reaches half a texel beyond its place; one more texel covers the rounding of
# places in float32, and the second makes cells an even number of texels apart.
GUARD_TEXELS = 2
# In a texture up to this side a place in float32 is good to 2^-12 texels.
MAX_PRECISE_TEXELS = 2**13


@dataclass(frozen=True, slots=True)
class AtlasCell:
    """A part's place in the atlas: a rectangle of texels with its guard band.

    x, y, width, height: the rectangle. column, row: of its first texel, in a grid of texels that
    counts from the middle of the face.
    """

    region: FaceRegion
    x: int
    y: int
    width: int
    height: int
    column: int
    row: int

    @property
    def viewport(self) -> tuple[int, int, int, int]:
        """Return the rectangle as OpenGL takes it."""
        return self.x, self.y, self.width, self.height

    @property
    def texel_transform(self) -> tuple[float, float, float, float]:
        """Return (x, y) of the face's middle in the atlas, and texels a unit of s and of t."""
        part = self.region
        return self.x - self.column, self.y - self.row, part.columns_per_unit, part.rows_per_unit

    @property
    def clip_from_mirror(self) -> Floats:
        """Return the (3, 3) map from directions in the mirror frame to clip x, y and w.

        w is the distance along the face's axis. y grows with t: row 0 of the texture is the top.
        """
        forward, right, down = MIRROR_FROM_FACE_ROTATIONS[self.region.face].T
        columns, rows = 2.0 * self.region.columns_per_unit, 2.0 * self.region.rows_per_unit
        x = (columns * right - (2.0 * self.column + self.width) * forward) / self.width
        y = (rows * down - (2.0 * self.row + self.height) * forward) / self.height
        return np.stack((x, y, forward))

    @property
    def max_depth_ratio(self) -> float:
        """Return the largest distance from the viewpoint of what is one metre ahead, in metres."""
        across = max(-self.column, self.column + self.width) / self.region.columns_per_unit
        along = max(-self.row, self.row + self.height) / self.region.rows_per_unit
        return math.sqrt(1.0 + across**2 + along**2)


@dataclass(frozen=True, slots=True)
class Atlas:
    """All cells, and the size of the texture that holds them."""

    cells: tuple[AtlasCell, ...]
    width: int
    height: int

    @property
    def num_faces(self) -> int:
        """Return how many faces a direction is compared with: U only where it is drawn."""
        return (
            len(Face) if any(cell.region.face is Face.U for cell in self.cells) else len(Face) - 1
        )

    def texel_transforms(self) -> Floats:
        """Return (faces, 4): Cell.place of each face, zero where it is not drawn."""
        places = np.zeros((self.num_faces, 4))
        for cell in self.cells:
            places[cell.region.face] = cell.texel_transform
        return places

    def texels_from_direction(self, direction: Floats) -> Floats:
        """Return (..., 2) atlas texel positions of (..., 3) directions in the mirror frame.

        Twin of glsl/include/atlas.glsl: the largest forward wins, the first of equals; without the
        upward face a direction beyond a side face's upper edge is held at that edge.
        """
        flat = direction.reshape(-1, 3)
        face = np.argmax(flat @ MIRROR_FROM_FACE_ROTATIONS[: self.num_faces, :, 0].T, axis=-1)
        texels = np.empty((len(flat), 2))
        for axes, index, place in zip(
            MIRROR_FROM_FACE_ROTATIONS, Face, self.texel_transforms(), strict=False
        ):
            own = face == index
            local = flat[own] @ axes
            st = np.clip(local[:, 1:] / np.maximum(local[:, :1], 1e-30), -1.0, 1.0)
            texels[own] = place[:2] + st * place[2:]
        return texels.reshape(*direction.shape[:-1], 2)


def pack_atlas(regions: tuple[FaceRegion, ...], *, guard_texels: int, max_texels: int) -> Atlas:
    """Return an atlas of the parts in a texture of at most `max_texels` a side.

    Cells stand in rows, the highest first; of all lengths of the first row that is taken which
    wastes least, because every texel of the atlas is cleared in every frame. An atlas so large that
    float32 places lose their precision is kept as square as it can be.
    """
    loose = sorted(
        (_make_cell(part, guard_texels) for part in regions), key=lambda cell: -cell.height
    )
    lengths = accumulate(cell.width for cell in loose)
    packings = [tuple(_pack_shelves(loose, length)) for length in lengths if length <= max_texels]
    sized = [(_packed_size(cells), cells) for cells in packings]
    fitting = [((w, h), cells) for (w, h), cells in sized if max(w, h) <= max_texels]
    if not fitting:
        widest = max(max(cell.width, cell.height) for cell in loose)
        raise DomainError(
            f"faces of up to {widest} px are too large: this OpenGL ends at {max_texels} px a side"
        )
    (width, height), cells = min(
        fitting, key=lambda packed: (max(MAX_PRECISE_TEXELS, *packed[0]), math.prod(packed[0]))
    )
    return Atlas(cells, width, height)


def _make_cell(region: FaceRegion, guard_texels: int) -> AtlasCell:
    """Return the cell of a part, not placed yet: whole texels that cover it, and the guard."""
    window = region.window
    columns = _texel_interval(window.left, window.right, region.columns_per_unit)
    rows = _texel_interval(window.top, window.bottom, region.rows_per_unit)
    width, height = columns[1] - columns[0] + 2 * guard_texels, rows[1] - rows[0] + 2 * guard_texels
    return AtlasCell(region, 0, 0, width, height, columns[0] - guard_texels, rows[0] - guard_texels)


def _texel_interval(low: float, high: float, per_unit: float) -> tuple[int, int]:
    return math.floor(low * per_unit), math.ceil(high * per_unit)


def _pack_shelves(cells: Iterable[AtlasCell], max_width: int) -> Iterator[AtlasCell]:
    """Yield the cells side by side, in a new row wherever one would reach beyond `longest`."""
    x = y = row_height = 0
    for cell in cells:
        if x + cell.width > max_width:
            x, y, row_height = 0, y + row_height, 0
        yield replace(cell, x=x, y=y)
        x, row_height = x + cell.width, max(row_height, cell.height)


def _packed_size(cells: tuple[AtlasCell, ...]) -> tuple[int, int]:
    return max(cell.x + cell.width for cell in cells), max(cell.y + cell.height for cell in cells)
