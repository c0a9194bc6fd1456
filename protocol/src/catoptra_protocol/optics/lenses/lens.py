"""What every camera with a lens answers: from a direction in its frame to a pixel, and back.

The camera frame is SAE: x along the optical axis, y right, z down. The picture is upright and not
mirrored: u grows with y, v with z; pixel centres are at +0.5.
"""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.numerics import Bools, Floats


class Lens(Protocol):
    """A camera that looks straight at the world."""

    @property
    def width_px(self) -> int:
        """Return the number of columns."""

    @property
    def height_px(self) -> int:
        """Return the number of rows."""

    def pixel_from_direction(self, direction: Floats) -> tuple[Floats, Bools]:
        """Return (..., 2) pixels of (..., 3) directions, and which are in the picture."""

    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Return unit (..., 3) directions of (..., 2) pixels, and which are in the picture."""
