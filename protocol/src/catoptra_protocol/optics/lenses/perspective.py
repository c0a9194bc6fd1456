"""The ordinary camera of USARSim: a pinhole, square pixels, the axis in the middle of the picture.

Source: the camera of UDK's and UT2004's engine, whose FOV is horizontal; no distortion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools, Floats

# A nanometre seen from a kilometre. Much narrower the focal length grows beyond all numbers.
_MIN_FOV_RAD = 1e-12


@dataclass(frozen=True, slots=True)
class PerspectiveCamera:
    """A picture of `width_px` x `height_px` whose left and right borders are `fov_rad` apart."""

    width_px: int
    height_px: int
    horizontal_fov_rad: float

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise DomainError(f"an image of {self.width_px} x {self.height_px} px has no pixel")
        if not _MIN_FOV_RAD <= self.horizontal_fov_rad < math.pi:
            raise DomainError(
                f"a flat picture cannot show {math.degrees(self.horizontal_fov_rad):g} deg: its field of view "
                f"must be above 0 ({_MIN_FOV_RAD:g} rad) and below 180 deg"
            )

    @property
    def focal_length_px(self) -> float:
        """Return the distance from the pinhole to the picture, in pixels."""
        return 0.5 * self.width_px / math.tan(0.5 * self.horizontal_fov_rad)

    @np.errstate(under="ignore")  # what vanishes beside the largest component may
    def pixel_from_direction(self, direction: Floats) -> tuple[Floats, Bools]:
        """Return (..., 2) pixels of (..., 3) directions in the camera frame, and which it sees.

        Directions need not be unit. Seen is what lies ahead and within the picture, its borders
        included. Where invalid the pixel is the middle of the picture, never a NaN.
        """
        direction = np.asarray(direction, dtype=np.float64)
        finite = np.isfinite(direction).all(axis=-1, keepdims=True)
        direction = np.where(finite, direction, 0.0)
        # The largest component becomes 1: no product below overflows or vanishes.
        largest = np.abs(direction).max(axis=-1, keepdims=True)
        x, y, z = np.moveaxis(direction / np.where(largest > 0.0, largest, 1.0), -1, 0)
        # Not y / x: inside the picture a quotient is bounded, beside it x may be next to nothing.
        inside = np.maximum(
            np.abs(y) * (2.0 * self.focal_length_px / self.width_px),
            np.abs(z) * (2.0 * self.focal_length_px / self.height_px),
        )
        valid = (x > 0.0) & (inside <= x)
        per_ahead = self.focal_length_px / np.where(valid, x, 1.0)
        u = np.where(valid, y, 0.0) * per_ahead + 0.5 * self.width_px
        v = np.where(valid, z, 0.0) * per_ahead + 0.5 * self.height_px
        return np.stack((u, v), axis=-1), valid

    @np.errstate(under="ignore")
    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Return unit (..., 3) directions in the camera frame of (..., 2) pixels, and which see.

        Valid are the places of the picture, its borders included; elsewhere the direction is +x.
        """
        pixel = np.asarray(pixel, dtype=np.float64)
        u, v = pixel[..., 0], pixel[..., 1]
        # A comparison with NaN is false. Axis by axis: a zoom computes every sample of a picture.
        valid = (u >= 0.0) & (u <= self.width_px) & (v >= 0.0) & (v <= self.height_px)
        y = np.where(valid, u - 0.5 * self.width_px, 0.0) / self.focal_length_px
        z = np.where(valid, v - 0.5 * self.height_px, 0.0) / self.focal_length_px
        norm = np.sqrt(1.0 + y * y + z * z)
        return np.stack((1.0 / norm, y / norm, z / norm), axis=-1), np.asarray(valid)
