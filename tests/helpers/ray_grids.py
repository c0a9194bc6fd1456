"""The rays of a table as the grid of samples of its image."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, RayTable
from catoptra_server.render.trace.trace_engine import assemble_grid


def grid_directions(rays: RayTable) -> Floats:
    """(h * samples, w * samples, 3) directions of the grid of samples; zero without a tile."""
    return assemble_grid(rays, rays.directions.swapaxes(-1, -2), fill=np.float32(0.0)).astype(
        np.float64
    )


def grid_validity(rays: RayTable) -> Bools:
    """(h * samples, w * samples) validity of the grid of samples."""
    bits = ((rays.valid[..., None] >> np.arange(BLOCK_RAYS)) & 1).astype(np.float32)
    return assemble_grid(rays, bits[..., None], fill=np.float32(0.0))[..., 0] > 0.0
