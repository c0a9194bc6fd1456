"""Several cameras' pictures in one: UDK's MultiView tiles and UT2004's viewports.

A tile shows a picture that was drawn at the tile's size; nothing is resized. What no camera fills
is black. Only who is looked at need be drawn: `tiles_overlapping` tells which tiles a request touches,
and a tile may stay empty.

UDK: camera i of those registered is at x = (i mod CameraTileX) CameraWidth and, as UDK's source
has it, y = (i div CameraTileY) CameraHeight. Here it is i div CameraTileX, the number of columns:
the two agree for the square layouts that were shipped, only this fills any other without a gap, and
it is how the Qt client with its four tiles a row counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES, MAX_IMAGE_SIDE_PX
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.renderer import Image


class ViewportConfig(Enum):
    """UT2004's `SET {Type Viewports} {Config ...}`."""

    SINGLE_VIEW = "SingleView"
    QUAD_VIEW = "QuadView"


@dataclass(frozen=True, slots=True)
class Tile:
    """A camera's rectangle in the picture: TextureOffset and TextureResolution of CONF Camera."""

    x_px: int
    y_px: int
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True)
class TileLayout:
    """Tiles of one size, row by row from the top left, in a picture of width_px x height_px."""

    columns: int
    rows: int
    tile_width_px: int
    tile_height_px: int
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        tile = (self.columns, self.rows, self.tile_width_px, self.tile_height_px)
        if min(tile) < 1:
            raise DomainError(
                f"{self.columns} x {self.rows} tiles of {self.tile_width_px} x "
                f"{self.tile_height_px} px are no picture"
            )

    def __len__(self) -> int:
        """Return the number of tiles."""
        return self.columns * self.rows

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """Return all tiles in their order."""
        return tuple(tile for tile in map(self.tile_at, range(len(self))) if tile)

    def tile_at(self, index: int) -> Tile | None:
        """Return a camera's tile by its index from 0; None where the layout has no more."""
        if not 0 <= index < len(self):
            return None
        row, column = divmod(index, self.columns)
        width, height = self.tile_width_px, self.tile_height_px
        return Tile(column * width, row * height, width, height)

    def tiles_overlapping(self, x: int, y: int, width: int, height: int) -> tuple[int, ...]:
        """Return the tiles that a request for a rectangle touches, clamped as `encode.cropped`."""
        columns = _overlapping_range(x, width, tile=self.tile_width_px, size=self.width_px)
        rows = _overlapping_range(y, height, tile=self.tile_height_px, size=self.height_px)
        return tuple(
            row * self.columns + column
            for row in rows
            for column in columns
            if row < self.rows and column < self.columns
        )


def multi_view_layout(columns: int, rows: int, *, width_px: int, height_px: int) -> TileLayout:
    """Return UDK's layout: CameraTileX, CameraTileY, CameraWidth, CameraHeight.

    Raises DomainError for a picture that no frame can carry, or no client of ours would take.
    """
    width, height = columns * width_px, rows * height_px
    if max(width, height) > MAX_IMAGE_SIDE_PX or 4 * width * height > MAX_IMAGE_PAYLOAD_BYTES:
        raise DomainError(
            f"a picture of {width} x {height} px: at most {MAX_IMAGE_SIDE_PX} px a side and "
            f"{MAX_IMAGE_PAYLOAD_BYTES // 4} px in all can be sent"
        )
    return TileLayout(columns, rows, width_px, height_px, width, height)


def viewport_layout(config: ViewportConfig, *, width_px: int, height_px: int) -> TileLayout:
    """Return UT2004's layout of a whole picture: Viewport1 all of it, or 1 to 4 a quarter each.

    Quarters are numbered as one reads: 1 and 2 above, 3 and 4 below. An odd last row or column of
    the picture belongs to none and stays black.
    """
    if config is ViewportConfig.SINGLE_VIEW:
        return TileLayout(1, 1, width_px, height_px, width_px, height_px)
    return TileLayout(2, 2, width_px // 2, height_px // 2, width_px, height_px)


def compose_tiles(layout: TileLayout, images: Sequence[Image | None]) -> Image:
    """Return the picture of all tiles, (height, width, 3), read-only. None: a black tile.

    A picture that is smaller than its tile lies in the tile's top left corner, so that its camera's
    law holds in the tile as it is. Raises DomainError for a larger one, and for more pictures than
    tiles.
    """
    whole = np.zeros((layout.height_px, layout.width_px, 3), dtype=np.uint8)
    for index, picture in enumerate(images):
        if picture is None:
            continue
        tile = layout.tile_at(index)
        if tile is None:
            raise DomainError(f"picture {index} has no tile: this layout has {len(layout)}")
        rows, columns = picture.shape[:2]
        if columns > tile.width_px or rows > tile.height_px:
            raise DomainError(
                f"a picture of {columns} x {rows} px does not fit its tile of "
                f"{tile.width_px} x {tile.height_px} px: draw it at the tile's size"
            )
        whole[tile.y_px : tile.y_px + rows, tile.x_px : tile.x_px + columns] = picture
    whole.setflags(write=False)
    return whole


def fit_omni_camera(tile: Tile, camera: OmniCamera) -> OmniCamera:
    """Return an omnidirectional camera at a tile's size: all of its picture, as large as it fits.

    The picture's middle is the tile's. Pixels are those of the tile: add its offset for the whole.
    """
    scale = min(tile.width_px / camera.width_px, tile.height_px / camera.height_px)
    u, v = camera.centre_px
    return replace(
        camera,
        width_px=tile.width_px,
        height_px=tile.height_px,
        centre_px=(
            0.5 * tile.width_px + scale * (u - 0.5 * camera.width_px),
            0.5 * tile.height_px + scale * (v - 0.5 * camera.height_px),
        ),
        horizon_radius_px=scale * camera.horizon_radius_px,
    )


def _overlapping_range(first: int, length: int, *, tile: int, size: int) -> range:
    """Return which intervals of a length `tile` from 0 on an interval touches, both clamped."""
    low = min(first, size - 1)
    high = min(max(first + length, low + 1), size)
    return range(low // tile, -(-high // tile))
