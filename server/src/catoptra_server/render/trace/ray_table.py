"""The rays of a camera: a grid of samples in the mirror frame, in blocks of 4 x 4 traced together.

A pixel has samples x samples rays; side by side the samples of all pixels form one grid, `samples`
times finer than the image. A tile is 4 x 4 pixels: samples x samples blocks of 4 x 4 rays, so that
the rays of a block are neighbours at any number of samples. Computed once per view in float64, from
the camera model or from the mirror mesh that replaces it, and stored in float32 for the kernel.

A mirror without a viewpoint has an origin for each ray besides its direction; a frame then takes
1.07 to 1.23 times as long as from one viewpoint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import rays_from_pixel_grid
from catoptra_protocol.optics.elementary import matmul
from catoptra_protocol.optics.image_plane import ImageSize
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.renderer import FaceCamera, PerPixel, RenderPlan

TILE_PX = 4
"""Pixels along a tile's side, and rays along a block's side."""
BLOCK_RAYS = TILE_PX * TILE_PX
"""Rays of a block."""
MAX_SAMPLES = 16
"""Samples along a pixel's side."""
# Float64 directions and all intermediate arrays take 130 bytes a sample, the result 13: a whole
# image of 8192 px took 8 GB. 9 MB, which are used again for the next batch: in a new process, where
# each page of memory has to be mapped first, batches of eight times the size take 20 % longer.
_SAMPLES_PER_BATCH = 2**16
Float32s = npt.NDArray[np.float32]
Element = TypeVar("Element", bound=np.generic)
# (w,) columns and (h,) rows to (h, w, 3) origins in the mirror frame or None, (h, w, 3) unit
# directions, and (h, w) validity.
_GridLookup = Callable[[Floats, Floats], tuple[Floats | None, Floats, Bools]]
# The same of (..., 2) pixel positions.
_PixelLookup = Callable[[Floats], tuple[Floats, Bools]]
_Circle = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class RayTable:
    """The rays of an image, for tiles with at least one valid ray."""

    width_px: int
    """Columns of the image."""
    height_px: int
    """Rows of the image."""
    samples: int
    """Samples along a pixel's side."""
    tiles: npt.NDArray[np.int32]
    """(t,) numbers of the tiles, row by row of the image, ceil(width_px / 4) tiles a row."""
    directions: Float32s
    """(t, samples^2, 3, 16) unit directions, mirror frame; +z where invalid. Blocks row by row in
    their tile, rays row by row in their block."""
    valid: npt.NDArray[np.uint16]
    """(t, samples^2) bit masks of the rays that see the mirror; bit 0 is a block's first ray."""
    origins: Float32s | None = None
    """(t, samples^2, 3, 16) origins in the mirror frame, metres; None: all at its origin, the
    effective viewpoint."""
    times: Float32s | None = None
    """(t, samples^2, 16) times within the exposure, from 0 at its first pose to 1 at its last;
    None: all rays at the first pose."""

    @property
    def memory_bytes(self) -> int:
        """Size of the arrays."""
        arrays = (self.tiles, self.directions, self.valid, self.origins, self.times)
        return sum(array.nbytes for array in arrays if array is not None)

    def sample_tiles(self, step: int) -> RayTable:
        """Every `step`-th tile of the same image."""
        return replace(
            self,
            tiles=self.tiles[::step].copy(),
            directions=self.directions[::step].copy(),
            valid=self.valid[::step].copy(),
            origins=None if self.origins is None else self.origins[::step].copy(),
            times=None if self.times is None else self.times[::step].copy(),
        )

    @property
    def num_tile_columns(self) -> int:
        """Tiles in a row of the image."""
        return -(-self.width_px // TILE_PX)


def omni_ray_table(camera: OmniCamera, plan: RenderPlan) -> RayTable:
    """Rays of an omnidirectional camera, by the camera model or by the plan's mirror mesh."""
    if isinstance(plan.surface, PerPixel):
        # A plane without a radial law is not bounded so closely.
        radius_px = camera.rim_radius_px if camera.plane.is_radial else math.inf
        look_up = partial(rays_from_pixel_grid, camera)
        return build_ray_table(camera, plan.samples, look_up, (*camera.centre_px, radius_px))
    # Loaded where a plan has a mesh: see `commands/server.py`.
    from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions

    of_mesh = partial(mirror_mesh_directions, camera, plan.surface)
    return build_ray_table(camera, plan.samples, _grid_lookup(of_mesh))


def lens_ray_table(
    camera: PerspectiveCamera, samples: int, mirror_from_camera: Floats | None = None
) -> RayTable:
    """Rays of a perspective camera, rotated by a (3, 3) rotation if there is one."""

    def look_up(pixels: Floats) -> tuple[Floats, Bools]:
        directions, valid = camera.direction_from_pixel(pixels)
        # Rotated here, in float64, so that a face's rays need no rotation of their own per frame.
        return (
            directions if mirror_from_camera is None else matmul(directions, mirror_from_camera.T),
            valid,
        )

    return build_ray_table(camera, samples, _grid_lookup(look_up))


def face_ray_table(camera: FaceCamera, samples: int) -> RayTable:
    """Rays of one virtual camera of the cube."""
    return lens_ray_table(camera.perspective_camera, samples, camera.mirror_from_camera)


def _grid_lookup(look_up: _PixelLookup) -> _GridLookup:
    """Directions of a grid by a function of pixel positions."""
    return lambda u, v: (None, *look_up(np.stack(np.meshgrid(u, v), axis=-1)))


def build_ray_table(
    camera: ImageSize, samples: int, look_up: _GridLookup, circle_px: _Circle = (0.0, 0.0, math.inf)
) -> RayTable:
    """Rays of an image, computed in batches of rows of tiles.

    Args:
        camera: Size of the image.
        samples: Samples along a pixel's side.
        look_up: Directions of a grid of positions, and their validity.
        circle_px: Circle outside which no ray is valid: u and v of its centre, and radius.

    Raises:
        DomainError: A number of samples that no pixel can have.
    """
    if not 1 <= samples <= MAX_SAMPLES:
        raise DomainError(f"{samples} samples along a pixel's side: from 1 to {MAX_SAMPLES}")
    batches = [
        _build_tile_rows(camera, samples, look_up, (rows, _find_columns(camera, circle_px, rows)))
        for rows in _split_rows(camera, samples)
    ]
    tiles, directions, valid = (
        np.concatenate(parts) for parts in zip(*(batch[:3] for batch in batches), strict=True)
    )
    starts = [batch[3] for batch in batches if batch[3] is not None]
    origins = np.concatenate(starts) if starts else None
    return RayTable(camera.width_px, camera.height_px, samples, tiles, directions, valid, origins)


def _split_rows(camera: ImageSize, samples: int) -> Iterator[range]:
    """Yield the rows of tiles in batches of at most _SAMPLES_PER_BATCH samples."""
    num_rows = -(-camera.height_px // TILE_PX)
    per_row = TILE_PX * camera.width_px * samples**2
    step = max(1, _SAMPLES_PER_BATCH // per_row)
    for first in range(0, num_rows, step):
        yield range(first, min(first + step, num_rows))


def _find_columns(camera: ImageSize, circle_px: _Circle, rows: range) -> range:
    """Columns of tiles with all pixels of some rows of tiles that lie in a circle; at least one."""
    count = -(-camera.width_px // TILE_PX)
    u, v, radius = circle_px
    # A pixel more than the circle: nothing here is rounded as in the camera model.
    nearest = min(max(v, rows.start * TILE_PX), rows.stop * TILE_PX)
    half = math.sqrt(max(0.0, (radius + 1.0 + nearest - v) * (radius + 1.0 - nearest + v)))
    if math.isinf(half):
        return range(count)
    first = min(max(math.floor((u - half) / TILE_PX), 0), count - 1)
    return range(first, min(max(math.ceil((u + half) / TILE_PX), first + 1), count))


def _build_tile_rows(
    camera: ImageSize, samples: int, look_up: _GridLookup, block: tuple[range, range]
) -> tuple[npt.NDArray[np.int32], Float32s, npt.NDArray[np.uint16], Float32s | None]:
    """Tiles, directions, validity and origins of some rows and columns of tiles."""
    rows, columns = block
    v = _grid_positions(rows.start * TILE_PX, rows.stop * TILE_PX, samples)
    u = _grid_positions(columns.start * TILE_PX, columns.stop * TILE_PX, samples)
    # Tiles of the last column and row may reach beyond the image: those rays are invalid.
    within = (v < camera.height_px)[:, None] & (u < camera.width_px)
    origins, directions, valid = look_up(u, v)
    if not within.all():
        valid = valid & within
        directions = np.where(within[..., None], directions, (0.0, 0.0, 1.0))
    blocks = _blocks_of_vectors(directions, samples)
    rays = _split_blocks(valid, samples).reshape(-1, samples**2, BLOCK_RAYS)
    bits = np.packbits(rays, axis=-1, bitorder="little").view("<u2")[..., 0]
    # Tiles off the mirror stay black without a ray: 1 - pi/4 of a square image with inscribed rim.
    shown = np.flatnonzero(bits.any(axis=-1))
    starts = None if origins is None else _blocks_of_vectors(origins, samples)[shown]
    row, column = np.divmod(shown, len(columns))
    numbers = (rows.start + row) * -(-camera.width_px // TILE_PX) + columns.start + column
    return numbers.astype(np.int32), blocks[shown], bits[shown], starts


def _grid_positions(first_px: int, stop_px: int, samples: int) -> Floats:
    """Positions of the sample grid along one axis, px; a pixel's samples are evenly spaced."""
    grid: Floats = (np.arange(first_px * samples, stop_px * samples) + 0.5) / samples
    return grid


def _blocks_of_vectors(vectors: Floats, samples: int) -> Float32s:
    """(tiles, samples^2, 3, 16) blocks of (rows, columns, 3) vectors of the sample grid."""
    num_rows, num_columns = (side // (TILE_PX * samples) for side in vectors.shape[:2])
    blocks = np.zeros((num_rows * num_columns, samples**2, 3, BLOCK_RAYS), dtype=np.float32)
    split = blocks.reshape(num_rows, num_columns, samples, samples, 3, TILE_PX, TILE_PX)
    for component in range(3):
        # Rounded to float32 on the way, without an array of float64 in this order.
        split[..., component, :, :] = _split_blocks(vectors[..., component], samples)
    return blocks


def _split_blocks(grid: npt.NDArray[Element], samples: int) -> npt.NDArray[Element]:
    """A (rows, columns) grid of samples by tile row, tile column, block row, block column, ray row
    and ray column: a view.
    """
    rows, columns = grid.shape
    side = TILE_PX * samples
    split = grid.reshape(rows // side, samples, TILE_PX, columns // side, samples, TILE_PX)
    return split.transpose(0, 3, 1, 4, 2, 5)
