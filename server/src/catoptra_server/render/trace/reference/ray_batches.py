"""Batches of a ray table: its valid rays one by one, and the pixels of rays in its layout."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, TILE_PX, RayTable
from catoptra_server.world.world_description import srgb_from_linear

# Rays of a batch: arrays of three numbers a ray stay in the cache; 2^16 take 2.5 times as long.
_RAYS_PER_BATCH = 2**14


@dataclass(frozen=True, slots=True, eq=False)
class RayBatch:
    """The valid rays of some tiles, mirror frame."""

    tiles: slice
    """Tiles in the table."""
    rays: npt.NDArray[np.intp]
    """(n,) flat indices of the valid rays in (tiles, samples^2, 16)."""
    directions: Floats
    """(n, 3) unit."""
    origins: Floats
    """(n, 3) metres."""
    steps: Floats
    """(n, 2, 3) from a direction to those of the samples to the right and below; one mean step each
    for the rays of a block."""
    times: Floats | None
    """(n,) times within the exposure, if the table has times."""


def split_tiles(table: RayTable) -> Iterator[slice]:
    """Yield all tiles of a table in parts of one batch each."""
    step = max(1, _RAYS_PER_BATCH // (BLOCK_RAYS * table.samples**2))
    for first in range(0, len(table.tiles), step):
        yield slice(first, first + step)


def read_batch(table: RayTable, tiles: slice) -> RayBatch:
    """The valid rays of some tiles."""
    is_valid = (table.valid[tiles, :, None] >> np.arange(BLOCK_RAYS)) & 1
    rays = np.flatnonzero(is_valid)
    directions = _select_vectors(table.directions[tiles], rays)
    origins = None if table.origins is None else _select_vectors(table.origins[tiles], rays)
    times = None if table.times is None else table.times[tiles].reshape(-1)[rays]
    return RayBatch(
        tiles,
        rays,
        # Unit in float32 only.
        directions / np.linalg.norm(directions, axis=-1, keepdims=True),
        np.zeros_like(directions) if origins is None else origins,
        _mean_steps(table.directions[tiles], is_valid)[rays // BLOCK_RAYS],
        None if times is None else times.astype(np.float64),
    )


def _select_vectors(blocks: npt.NDArray[np.float32], rays: npt.NDArray[np.intp]) -> Floats:
    """(n, 3) vectors of some rays in (t, samples^2, 3, 16) blocks."""
    return blocks.swapaxes(-1, -2).reshape(-1, 3)[rays].astype(np.float64)


def _mean_steps(directions: npt.NDArray[np.float32], is_valid: npt.NDArray[np.integer]) -> Floats:
    """(blocks, 2, 3) mean steps to the right and down between valid rays; zero where are none.

    Args:
        directions: (t, samples^2, 3, 16).
        is_valid: (t, samples^2, 16) of zeros and ones.
    """
    grid = directions.astype(np.float64).reshape(-1, 3, TILE_PX, TILE_PX)
    valid = is_valid.reshape(-1, 1, TILE_PX, TILE_PX).astype(np.float64)
    steps = []
    for axis in (3, 2):
        before = [slice(None)] * 4
        after = [slice(None)] * 4
        before[axis], after[axis] = slice(0, -1), slice(1, None)
        pairs = valid[tuple(before)] * valid[tuple(after)]
        total = ((grid[tuple(after)] - grid[tuple(before)]) * pairs).sum(axis=(2, 3))
        steps.append(total / np.maximum(pairs.sum(axis=(2, 3)), 1.0))
    return np.stack(steps, axis=1)


def mean_pixels(values: Floats, samples: int) -> Floats:
    """(t, 4, 4, k) means over the samples of each pixel, of (t, samples^2, 16, k) rays."""
    depth = values.shape[-1]
    blocks = values.reshape(-1, samples, samples, TILE_PX, TILE_PX, depth)
    # Axes: tile, block row, ray row, block column, ray column; rows of the grid are both together.
    grid = blocks.swapaxes(2, 3).reshape(-1, TILE_PX, samples, TILE_PX, samples, depth)
    means: Floats = grid.mean(axis=(2, 4))
    return means


def encode_pixels(radiance: Floats, samples: int) -> npt.NDArray[np.uint8]:
    """(t, 4, 4, 3) sRGB of the means of (t, samples^2, 16, 3) rays, each clipped as on a sensor."""
    means = mean_pixels(np.clip(radiance, 0.0, 1.0), samples)
    return np.rint(255.0 * srgb_from_linear(means)).astype(np.uint8)
