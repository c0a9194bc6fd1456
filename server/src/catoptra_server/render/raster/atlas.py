"""Where the faces of the cube lie in one texture, and how each is projected there. Knows no GL.

One 2-D texture instead of a cube map: every face is drawn a few texels wider than 90 degrees, so
that bilinear look-ups never cross a border and no seam exists; and only the part of a face that the
mirror looks into has texels at all. Row 0 of the texture is the top of every face.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube import FACE_AXES, Face
from catoptra_protocol.optics.numerics import Floats

# A bilinear look-up reaches half a texel beyond its place; one more texel covers the rounding of
# places in float32, and the second makes cells an even number of texels apart.
GUARD_TEXELS = 2


@dataclass(frozen=True, slots=True)
class Window:
    """A part of a face's plane: s from `left` to `right`, t from `top` to `bottom`."""

    left: float = -1.0
    top: float = -1.0
    right: float = 1.0
    bottom: float = 1.0

    @property
    def is_empty(self) -> bool:
        """Return whether nothing of the face is left."""
        return self.left >= self.right or self.top >= self.bottom


def seen_window(face: Face, limit_rad: float) -> Window:
    """Return the smallest window of a face that holds all directions up to an incidence angle."""
    if face is Face.U:
        return Window()
    if face is Face.C:
        half = math.tan(limit_rad) if limit_rad < 0.25 * math.pi else 1.0
        return Window(-half, -half, half, half)
    # On a side face t = cot(theta) / cos(azimuth off its middle): smallest in the middle below the
    # horizon, at the edge of the face, sqrt 2 farther, above it.
    cotangent = 1.0 / math.tan(limit_rad)
    highest = cotangent if cotangent > 0.0 else math.sqrt(2.0) * cotangent
    return Window(top=max(highest, -1.0))


@dataclass(frozen=True, slots=True)
class Cell:
    """A face's place in the atlas: a rectangle of texels with its guard band.

    x, y, width, height: the rectangle. column, row: of its first texel, in the face's own grid of
    `size` x `size` texels; negative in the guard band.
    """

    face: Face
    size: int
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
    def centre(self) -> tuple[float, float]:
        """Return the atlas texel position of the face's middle, s = t = 0."""
        return self.x - self.column + 0.5 * self.size, self.y - self.row + 0.5 * self.size

    @property
    def clip_from_mirror(self) -> Floats:
        """Return the (3, 3) map from directions in the mirror frame to clip x, y and w.

        w is the distance along the face's axis. y grows with t: row 0 of the texture is the top.
        """
        forward, right, down = FACE_AXES[self.face].T
        centre_x, centre_y = self.centre
        x = (self.size * right + (2.0 * (centre_x - self.x) - self.width) * forward) / self.width
        y = (self.size * down + (2.0 * (centre_y - self.y) - self.height) * forward) / self.height
        return np.stack((x, y, forward))

    @property
    def spread(self) -> float:
        """Return the largest distance from the viewpoint of what is one metre ahead, in metres."""
        columns = max(-self.column, self.column + self.width - self.size)
        rows = max(-self.row, self.row + self.height - self.size)
        across = (1.0 + 2.0 * np.maximum((columns, rows), 0) / self.size) ** 2
        return math.sqrt(1.0 + float(across.sum()))


@dataclass(frozen=True, slots=True)
class Atlas:
    """All cells, and the texture that holds them."""

    cells: tuple[Cell, ...]
    width: int
    height: int
    face_size: int

    def face_centres(self) -> Floats:
        """Return (6, 2) texel positions of the faces' middles; zero for a face without a cell."""
        centres = np.zeros((len(Face), 2))
        for cell in self.cells:
            centres[cell.face] = cell.centre
        return centres


def pack_atlas(
    faces: tuple[Face, ...], *, size: int, limit_rad: float, guard: int, max_texels: int
) -> Atlas:
    """Return the atlas of those faces that are seen up to an incidence angle.

    Cells stand side by side in as few rows as a texture of `max_texels` allows: one row wastes
    nothing, and every texel of the atlas is cleared in every frame.
    """
    windows = {face: seen_window(face, limit_rad) for face in faces}
    loose = [_cell(face, size, guard, w) for face, w in windows.items() if not w.is_empty]
    widest = max(cell.width for cell in loose)
    per_row = min(max_texels // widest, len(loose))
    if per_row < 1:
        raise DomainError(f"a face of {size} px is too large: this OpenGL ends at {max_texels} px")
    rows = [loose[first : first + per_row] for first in range(0, len(loose), per_row)]
    heights = [max(cell.height for cell in row) for row in rows]
    if sum(heights) > max_texels:
        raise DomainError(f"faces of {size} px do not fit a texture of {max_texels} px a side")
    tops = accumulate(heights, initial=0)
    cells = [cell for row, top in zip(rows, tops, strict=False) for cell in _placed(row, top)]
    width = max(cell.x + cell.width for cell in cells)
    return Atlas(tuple(cells), width, sum(heights), size)


def _cell(face: Face, size: int, guard: int, window: Window) -> Cell:
    """Return the cell of a window, not placed yet: whole texels that cover it, and the guard."""
    columns = _texels(window.left, window.right, size)
    rows = _texels(window.top, window.bottom, size)
    return Cell(
        face=face,
        size=size,
        x=0,
        y=0,
        width=columns[1] - columns[0] + 2 * guard,
        height=rows[1] - rows[0] + 2 * guard,
        column=columns[0] - guard,
        row=rows[0] - guard,
    )


def _texels(low: float, high: float, size: int) -> tuple[int, int]:
    return math.floor(0.5 * (low + 1.0) * size), math.ceil(0.5 * (high + 1.0) * size)


def _placed(row: list[Cell], y: int) -> Iterator[Cell]:
    """Yield the cells of a row from left to right."""
    lefts = accumulate((cell.width for cell in row), initial=0)
    for cell, x in zip(row, lefts, strict=False):
        yield Cell(cell.face, cell.size, x, y, cell.width, cell.height, cell.column, cell.row)
