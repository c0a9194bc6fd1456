"""Interface of the lens models: from a direction in the camera frame to a pixel, and back.

The camera frame is SAE: x along the optical axis, y right, z down. The image is upright and not
mirrored: u grows with y, v with z; pixel centres are at +0.5.
"""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.numerics import Bools, Floats


class Lens(Protocol):
    """Camera with a direct view of the world, without a mirror."""

    @property
    def width_px(self) -> int:
        """Number of columns."""

    @property
    def height_px(self) -> int:
        """Number of rows."""

    def pixel_from_direction(self, direction: Floats) -> tuple[Floats, Bools]:
        """Pixels (..., 2) of (..., 3) directions, and a mask of those inside the image."""

    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Unit directions (..., 3) of (..., 2) pixels, and a mask of those inside the image."""
