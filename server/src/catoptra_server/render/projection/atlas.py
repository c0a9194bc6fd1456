"""The atlas of cube faces, and the lookup map of the mirror's image into it.

The atlas is one 2-D texture for all drawn regions of the faces, instead of a cube map: a viewport
for each region, regions of different sizes, and only directions that the mirror reflects have
texels. A guard band of a few texels around every region keeps bilinear look-ups inside, so there
are no seams. Row 0 of the texture is the top of every region.

The lookup map holds the atlas coordinates of every sample. Coordinates never change, so all are
computed once in float64 by the camera model and rounded to float32 as a position between texels:
within 6e-4 px of the model up to 4096 px (1.4e-3 within 1.5 degrees of the asymptote at k = 2.001).
A shader that evaluated the model in float32 lost 2e-3 there and took up to half as long again on
llvmpipe. No mirror needs a shader of its own. The price is 8 bytes a sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.renderer import FaceRegion

# A bilinear look-up reaches half a texel beyond its position; one more texel covers the rounding of
# positions in float32, and the second makes cells an even number of texels apart.
GUARD_TEXELS = 2
# Coordinate of a sample that does not see the mirror; shaders test for a negative value.
OUTSIDE_MIRROR = -1.0
# In a texture up to this side a float32 coordinate is accurate to 2^-12 texels.
_MAX_PRECISE_TEXELS = 2**13
# Samples of one batch: intermediate float64 values stay in the processor's cache.
_SAMPLES_PER_BATCH = 2**16


@dataclass(frozen=True, slots=True)
class Atlas:
    """All cells, and the size of the texture that holds them."""

    cells: tuple[AtlasCell, ...]
    """One cell for each drawn region."""
    width: int
    """Columns of the texture."""
    height: int
    """Rows of the texture."""

    @property
    def num_faces(self) -> int:
        """Number of faces that a direction is compared with: U only if U has a cell."""
        return (
            len(Face) if any(cell.region.face is Face.U for cell in self.cells) else len(Face) - 1
        )

    def texel_transforms(self) -> Floats:
        """(num_faces, 4) texel transform of each face, zero for a face without a cell."""
        transforms = np.zeros((self.num_faces, 4))
        for cell in self.cells:
            transforms[cell.region.face] = cell.texel_transform
        return transforms

    def texels_from_direction(self, direction: Floats) -> Floats:
        """Atlas texel positions of directions in the mirror frame.

        Twin of glsl/include/atlas.glsl: the largest forward component wins, the first of equals.
        Without the upward face a direction beyond a side face's upper edge is clamped to that edge.

        Args:
            direction: (..., 3) directions of any length.

        Returns:
            (..., 2) positions in texels, (0, 0) at the corner of the first texel.
        """
        flat = direction.reshape(-1, 3)
        face = np.argmax(flat @ MIRROR_FROM_FACE_ROTATIONS[: self.num_faces, :, 0].T, axis=-1)
        texels = np.empty((len(flat), 2))
        for axes, index, transform in zip(
            MIRROR_FROM_FACE_ROTATIONS, Face, self.texel_transforms(), strict=False
        ):
            is_on_face = face == index
            local = flat[is_on_face] @ axes
            # Straight up has no forward component on any side face: the floor keeps the division
            # finite and the clamp puts the direction on the edge.
            st = np.clip(local[:, 1:] / np.maximum(local[:, :1], 1e-30), -1.0, 1.0)
            texels[is_on_face] = transform[:2] + st * transform[2:]
        return texels.reshape(*direction.shape[:-1], 2)


@dataclass(frozen=True, slots=True)
class AtlasCell:
    """A face region in the atlas: a rectangle of texels with its guard band."""

    region: FaceRegion
    """Window of the face and texels per unit of its coordinates (s, t)."""
    x: int
    """Column of the atlas that holds the rectangle's first column."""
    y: int
    """Row of the atlas that holds the rectangle's first row."""
    width: int
    """Columns, guard band included."""
    height: int
    """Rows, guard band included."""
    column: int
    """First column in the face's own texel grid, whose origin is the face's centre."""
    row: int
    """First row in the face's own texel grid, whose origin is the face's centre."""

    @property
    def viewport(self) -> tuple[int, int, int, int]:
        """Rectangle (x, y, width, height) as OpenGL expects it."""
        return self.x, self.y, self.width, self.height

    @property
    def texel_transform(self) -> tuple[float, float, float, float]:
        """Map from (s, t) to atlas texels: (x, y) of the face's centre, texels per unit of s, t."""
        region = self.region
        return (
            self.x - self.column,
            self.y - self.row,
            region.columns_per_unit,
            region.rows_per_unit,
        )

    @property
    def clip_from_mirror(self) -> Floats:
        """(3, 3) map from directions in the mirror frame to clip x, y and w.

        w is the distance along the face's axis. y grows with t: row 0 of the texture is the top.
        """
        forward, right, down = MIRROR_FROM_FACE_ROTATIONS[self.region.face].T
        columns, rows = 2.0 * self.region.columns_per_unit, 2.0 * self.region.rows_per_unit
        # Clip x is linear in the texel column: -1 at `column`, +1 at `column + width`, where the
        # texel column of a direction is columns_per_unit * right / forward.
        x = (columns * right - (2.0 * self.column + self.width) * forward) / self.width
        y = (rows * down - (2.0 * self.row + self.height) * forward) / self.height
        return np.stack((x, y, forward))


def pack_atlas(regions: tuple[FaceRegion, ...], *, guard_texels: int, max_texels: int) -> Atlas:
    """Pack face regions into the texture of least area.

    Cells stand in shelves, the highest first. Of all widths of the first shelf the one with the
    fewest texels wins, because every frame clears every texel of the atlas. An atlas so large that
    float32 coordinates lose precision is packed as square as possible instead.

    Args:
        regions: Face regions of the render plan.
        guard_texels: Texels around each region on every side.
        max_texels: Largest side of a texture on this device.

    Raises:
        DomainError: No packing fits into a texture of `max_texels` a side.
    """
    unpositioned = sorted(
        (_make_cell(region, guard_texels) for region in regions), key=lambda cell: -cell.height
    )
    # A shelf as wide as the first n cells of the sorted list, for every n: every packing that
    # shelves can produce with a full first shelf.
    widths = accumulate(cell.width for cell in unpositioned)
    packings = [
        tuple(_pack_shelves(unpositioned, width)) for width in widths if width <= max_texels
    ]
    sized = [(_packed_size(cells), cells) for cells in packings]
    fitting = [((w, h), cells) for (w, h), cells in sized if max(w, h) <= max_texels]
    if not fitting:
        longest = max(max(cell.width, cell.height) for cell in unpositioned)
        raise DomainError(
            f"faces of up to {longest} px are too large: this OpenGL allows {max_texels} px a side"
        )
    # Area decides, but only among atlases within _MAX_PRECISE_TEXELS; beyond that the longer side
    # decides first, since precision falls with the side.
    (width, height), cells = min(
        fitting, key=lambda packed: (max(_MAX_PRECISE_TEXELS, *packed[0]), math.prod(packed[0]))
    )
    return Atlas(cells, width, height)


def _make_cell(region: FaceRegion, guard_texels: int) -> AtlasCell:
    """Cell of a region, not positioned yet: whole texels over the region, and the guard band."""
    window = region.window
    columns = _texel_interval(window.left, window.right, region.columns_per_unit)
    rows = _texel_interval(window.top, window.bottom, region.rows_per_unit)
    width, height = columns[1] - columns[0] + 2 * guard_texels, rows[1] - rows[0] + 2 * guard_texels
    return AtlasCell(region, 0, 0, width, height, columns[0] - guard_texels, rows[0] - guard_texels)


def _texel_interval(low: float, high: float, per_unit: float) -> tuple[int, int]:
    """First texel and one past the last that cover an interval of face coordinates."""
    return math.floor(low * per_unit), math.ceil(high * per_unit)


def _pack_shelves(cells: Iterable[AtlasCell], max_width: int) -> Iterator[AtlasCell]:
    """Yield the cells side by side; start a new shelf where a cell would exceed `max_width`."""
    x = y = row_height = 0
    for cell in cells:
        if x + cell.width > max_width:
            x, y, row_height = 0, y + row_height, 0
        yield replace(cell, x=x, y=y)
        x, row_height = x + cell.width, max(row_height, cell.height)


def _packed_size(cells: tuple[AtlasCell, ...]) -> tuple[int, int]:
    """Width and height of the rectangle that holds all cells."""
    return max(cell.x + cell.width for cell in cells), max(cell.y + cell.height for cell in cells)


def compute_lookup_map(camera: OmniCamera, atlas: Atlas, samples: int) -> npt.NDArray[np.float32]:
    """Atlas coordinates of a grid of samples x samples in each pixel.

    Row and column r of the array belong to sample r of the grid that pixel_sample_positions has.

    Returns:
        (height samples, width samples, 2) float32 coordinates over the atlas' size, or
            OUTSIDE_MIRROR.
    """
    columns = (np.arange(camera.width_px * samples) + 0.5) / samples
    rows = (np.arange(camera.height_px * samples) + 0.5) / samples
    coordinates = np.empty((len(rows), len(columns), 2), dtype=np.float32)
    batch_rows = max(1, _SAMPLES_PER_BATCH // len(columns))
    # In batches of rows: all float64 directions of a 4096 px image at 4 x 4 samples would take 6
    # GB.
    for first in range(0, len(rows), batch_rows):
        batch = slice(first, first + batch_rows)
        coordinates[batch] = atlas_coordinates(
            camera, atlas, np.stack(np.meshgrid(columns, rows[batch]), axis=-1)
        )
    return coordinates


def atlas_coordinates(camera: OmniCamera, atlas: Atlas, pixels: Floats) -> npt.NDArray[np.float32]:
    """Atlas coordinates of pixel positions, or OUTSIDE_MIRROR.

    Args:
        camera: Camera model.
        atlas: Atlas that the coordinates refer to.
        pixels: (..., 2) pixel positions.

    Returns:
        (..., 2) float32 coordinates in units of the atlas' width and height.
    """
    directions, on_mirror = direction_from_pixel(camera, pixels)
    texels = atlas.texels_from_direction(directions)
    coordinates = np.where(
        on_mirror[..., None], texels / (atlas.width, atlas.height), OUTSIDE_MIRROR
    )
    return coordinates.astype(np.float32)
