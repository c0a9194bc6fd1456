"""Sample positions in the pixels of an image, and other conventions of pixel coordinates."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from catoptra_protocol.optics.numerics import Floats


class ImageSize(Protocol):
    """Any camera model with an image size."""

    @property
    def width_px(self) -> int:
        """Number of columns."""

    @property
    def height_px(self) -> int:
        """Number of rows."""


def pixel_sample_positions(
    camera: ImageSize, samples_per_side: int = 1, *, rows: range | None = None
) -> Floats:
    """Positions (height, width, samples^2, 2) of a regular sample grid in each pixel.

    Args:
        camera: size of the image.
        samples_per_side: samples along a pixel's side.
        rows: consecutive rows of the image; None for all.
    """
    rows = range(camera.height_px) if rows is None else rows
    offsets = (np.arange(samples_per_side) + 0.5) / samples_per_side
    u = np.arange(camera.width_px)[:, None] + offsets
    v = np.arange(rows.start, rows.stop)[:, None] + offsets
    grid_v, grid_u = np.broadcast_arrays(v[:, None, :, None], u[None, :, None, :])
    grid = np.stack((grid_u, grid_v), axis=-1)
    return grid.reshape(len(rows), camera.width_px, samples_per_side * samples_per_side, 2)


def opencv_from_pixel(pixel: Floats) -> Floats:
    """Pixels in OpenCV's convention, in which pixel centres are integers."""
    return pixel - 0.5
