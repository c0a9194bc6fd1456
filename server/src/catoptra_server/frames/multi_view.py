"""Several cameras in one image: UDK's MultiView tiles and UT2004's viewports.

A tile shows an image rendered at the tile's size; nothing is resized, and an unused tile is black.
A request for a rectangle needs only the tiles under it (`TileLayout.tiles_overlapping`). Which
camera a viewport shows is state of the robot, set by `SET {Type Viewports}`.

UDK puts camera i at x = (i mod CameraTileX) CameraWidth and, in its source, at y = (i div
CameraTileY) CameraHeight. Here y is (i div CameraTileX) CameraHeight, by the number of columns: the
two agree for UDK's square layouts, only this form fills any other layout without a gap, and the Qt
client counts its four tiles a row in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES, MAX_IMAGE_SIDE_PX
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.command_results import (
    CAMERA_DISABLED,
    CAMERA_MISSING,
    NUM_VIEWPORTS,
    STATUS_FAILED,
    STATUS_OK,
)
from catoptra_protocol.usarsim.commands import SetViewports
from catoptra_protocol.usarsim.reports import Viewport, ViewportsResult
from catoptra_server.render.renderer import Image

# UDK's largest layout in use has 4 x 4 tiles. Each tile is a camera of its own.
MAX_TILES = 64


class ViewportConfig(Enum):
    """Config of UT2004's `SET {Type Viewports}`."""

    SINGLE_VIEW = "SingleView"
    QUAD_VIEW = "QuadView"


@dataclass(frozen=True, slots=True)
class Tile:
    """Rectangle of a camera in the image: TextureOffset and TextureResolution of CONF Camera."""

    x_px: int
    y_px: int
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True)
class TileLayout:
    """Tiles of one size, row by row from the top left."""

    columns: int
    rows: int
    tile_width_px: int
    tile_height_px: int
    width_px: int
    """Width of the whole image, which may exceed the tiles by an odd last column."""
    height_px: int
    """Height of the whole image, which may exceed the tiles by an odd last row."""

    def __post_init__(self) -> None:
        tile = (self.columns, self.rows, self.tile_width_px, self.tile_height_px)
        if min(tile) < 1:
            raise DomainError(
                f"a layout of {self.columns} x {self.rows} tiles of {self.tile_width_px} x "
                f"{self.tile_height_px} px has no pixel: each number must be at least 1"
            )

    def __len__(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the whole image in pixels, as NumPy orders them."""
        return self.height_px, self.width_px

    @property
    def first_tile(self) -> Tile:
        """Tile of index 0."""
        return Tile(0, 0, self.tile_width_px, self.tile_height_px)

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """All tiles, in the order of their indices."""
        return tuple(tile for tile in map(self.tile_at, range(len(self))) if tile)

    def tile_at(self, index: int) -> Tile | None:
        """Tile of an index from 0; None beyond the last tile."""
        if not 0 <= index < len(self):
            return None
        row, column = divmod(index, self.columns)
        width, height = self.tile_width_px, self.tile_height_px
        return Tile(column * width, row * height, width, height)

    def tiles_overlapping(self, x: int, y: int, width: int, height: int) -> tuple[int, ...]:
        """Indices of the tiles under a rectangle, clamped to the image as by `encode.crop`."""
        columns = _overlapping_range(x, width, tile=self.tile_width_px, size=self.width_px)
        rows = _overlapping_range(y, height, tile=self.tile_height_px, size=self.height_px)
        # An odd last column or row of the image lies beyond the last tile.
        return tuple(
            row * self.columns + column
            for row in rows
            for column in columns
            if row < self.rows and column < self.columns
        )


def multi_view_layout(columns: int, rows: int, *, width_px: int, height_px: int) -> TileLayout:
    """Layout of UDK's CameraTileX x CameraTileY tiles of CameraWidth x CameraHeight pixels.

    Raises:
        DomainError: The image would exceed the limits of a frame, or have more than MAX_TILES.
    """
    width, height = columns * width_px, rows * height_px
    # Four bytes a pixel: the largest payload, raw rows with padding, has to fit into a message.
    if max(width, height) > MAX_IMAGE_SIDE_PX or 4 * width * height > MAX_IMAGE_PAYLOAD_BYTES:
        raise DomainError(
            f"an image of {width} x {height} px exceeds the limits of {MAX_IMAGE_SIDE_PX} px a "
            f"side and {MAX_IMAGE_PAYLOAD_BYTES // 4} px in all"
        )
    if columns * rows > MAX_TILES:
        raise DomainError(
            f"{columns} x {rows} tiles are too many: a layout has at most {MAX_TILES}"
        )
    return TileLayout(columns, rows, width_px, height_px, width, height)


def viewport_layout(config: ViewportConfig, *, width_px: int, height_px: int) -> TileLayout:
    """Layout of UT2004's viewports in an image of a given size.

    A single view fills the image. In a quad view each viewport has a quarter, 1 and 2 above, 3 and
    4 below; an odd last row or column of the image stays black.
    """
    if config is ViewportConfig.SINGLE_VIEW:
        return TileLayout(1, 1, width_px, height_px, width_px, height_px)
    return TileLayout(2, 2, width_px // 2, height_px // 2, width_px, height_px)


def compose_tiles(layout: TileLayout, images: Sequence[Image | None]) -> Image:
    """Compose the images of tiles to one image.

    Args:
        layout: Positions of the tiles.
        images: Image of each tile by index; None for a black tile. A smaller image lies in the top
            left corner of its tile, so that the camera model holds in the tile without an offset.

    Returns:
        (height, width, 3) uint8, read-only.

    Raises:
        DomainError: An image is larger than its tile, or has no tile.
    """
    composed = np.zeros((*layout.shape, 3), dtype=np.uint8)
    for index, image in enumerate(images):
        if image is None:
            continue
        tile = layout.tile_at(index)
        if tile is None:
            raise DomainError(f"image {index} has no tile in a layout of {len(layout)}")
        rows, columns = image.shape[:2]
        if columns > tile.width_px or rows > tile.height_px:
            raise DomainError(
                f"an image of {columns} x {rows} px exceeds its tile of {tile.width_px} x "
                f"{tile.height_px} px: render it at the tile's size"
            )
        # Top left, not centred: camera and tile have one pixel (0, 0).
        composed[tile.y_px : tile.y_px + rows, tile.x_px : tile.x_px + columns] = image
    # Read-only: several connections may encode the image at once.
    composed.setflags(write=False)
    return composed


def fit_omni_camera(tile: Tile, camera: OmniCamera) -> OmniCamera:
    """Scale an omnidirectional camera to the largest image that fits into a tile, centred.

    Returns:
        A camera of the tile's size, in pixels of the tile: add the tile's offset for pixels of the
        whole image.
    """
    # One scale for both axes: a camera model with one focal length has square pixels.
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
        scale_px=scale * camera.scale_px,
    )


_CONFIGS = tuple(config.value for config in ViewportConfig)
# Clients differ in the word that switches a viewport off.
_DISABLE_KEYWORDS = ("disable", "disabled", "none")


class Viewports:
    """Viewports of one robot; at first the first camera fills the image."""

    def __init__(self, cameras: Sequence[str]) -> None:
        """Start with the first of the robot's cameras, given by name."""
        self._cameras = tuple(cameras)
        self._config = _CONFIGS[0]
        # All four viewports exist from the start: RES reports each, whatever the division.
        first = [Viewport(name) for name in self._cameras[:1]]
        self._viewports = (*first, *[Viewport()] * (NUM_VIEWPORTS - len(first)))

    @property
    def config(self) -> ViewportConfig:
        """Division of the image."""
        return ViewportConfig(self._config)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Camera of each viewport; a name that no camera has for a viewport that is off."""
        return tuple(viewport.camera for viewport in self._viewports)

    def execute(self, command: SetViewports, time_s: float) -> ViewportsResult:
        """Apply a command; viewports and division that the command leaves out keep their state."""
        configs = {config.lower(): config for config in _CONFIGS}
        requested = command.config or self._config
        # An unknown Config fails, but the viewports of the same command are applied all the same.
        self._config = configs.get(requested.lower(), self._config)
        self._viewports = tuple(
            old if name is None else self._viewport(name)
            for old, name in zip(self._viewports, command.cameras, strict=True)
        )
        status = STATUS_OK if requested.lower() in configs else STATUS_FAILED
        return ViewportsResult(time_s, self._config, self._viewports, status)

    def _viewport(self, name: str) -> Viewport:
        if name.lower() in _DISABLE_KEYWORDS:
            return Viewport(CAMERA_DISABLED)
        for camera in self._cameras:
            if camera.lower() == name.lower():
                return Viewport(camera)
        return Viewport(CAMERA_MISSING, STATUS_FAILED)


def _overlapping_range(first: int, length: int, *, tile: int, size: int) -> range:
    """Indices of the intervals [i tile, (i + 1) tile) that overlap an interval in [0, size)."""
    low = min(first, size - 1)
    high = min(max(first + length, low + 1), size)
    return range(low // tile, -(-high // tile))  # rounded down and up
