"""Perspective camera of USARSim: a pinhole with square pixels and a central optical axis.

Source: the cameras of the UDK and UT2004 engines, whose field of view is horizontal; no distortion.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import hypot, tan
from catoptra_protocol.optics.image_plane import cosine_fourth
from catoptra_protocol.optics.numerics import Bools, Floats, scale_components
from catoptra_protocol.slotted_dataclass import dataclass

# A nanometre at a distance of a kilometre. Much narrower fields have no finite focal length.
_MIN_FOV_RAD = 1e-12


@dataclass(frozen=True, slots=True)
class PerspectiveCamera:
    """Pinhole camera, described by image size and horizontal field of view."""

    width_px: int
    """Number of columns."""
    height_px: int
    """Number of rows."""
    horizontal_fov_rad: float
    """Angle between the left and the right border of the image; in (0, pi)."""

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise DomainError(f"an image of {self.width_px} x {self.height_px} px has no pixel")
        if not _MIN_FOV_RAD <= self.horizontal_fov_rad < math.pi:
            raise DomainError(
                f"a flat image cannot show {math.degrees(self.horizontal_fov_rad):g} deg: "
                f"its field of view "
                f"must be above 0 ({_MIN_FOV_RAD:g} rad) and below 180 deg"
            )

    @property
    def focal_length_px(self) -> float:
        """Distance from the pinhole to the image plane, in pixels."""
        return 0.5 * self.width_px / tan(0.5 * self.horizontal_fov_rad)

    @property
    def centre_px(self) -> tuple[float, float]:
        """Pixel of the optical axis: the image centre."""
        return 0.5 * self.width_px, 0.5 * self.height_px

    @property
    def optical_axis(self) -> tuple[float, float, float]:
        """+x of the camera frame."""
        return 1.0, 0.0, 0.0

    @property
    def rim_radius_px(self) -> float:
        """Image radius of the corners."""
        return 0.5 * hypot(self.width_px, self.height_px)

    @property
    def horizon_radius_px(self) -> float:
        """Infinite: a flat image ends below 90 degrees."""
        return math.inf

    @property
    def max_stretch(self) -> float:
        """1: square pixels."""
        return 1.0

    @property
    def inverse_focal_length(self) -> float:
        """1 / f, 1/px: the tangent of a direction's angle from the axis per image radius."""
        return 1.0 / self.focal_length_px

    def relative_illumination(self, radius_px: Floats) -> Floats:
        """cos^4 of the angle from the axis at image radii."""
        return cosine_fourth(np.asarray(radius_px) * self.inverse_focal_length)

    def t_from_radius_px(self, radius_px: Floats) -> Floats:
        """tan(theta / 2) of image radii r = f tan(theta)."""
        tangent = np.asarray(radius_px, dtype=np.float64) * self.inverse_focal_length
        # tan(theta / 2) = tan / (1 + 1 / cos): no arctangent, and no cancellation on the axis.
        t: Floats = tangent / (1.0 + hypot(1.0, tangent))
        return t

    def radius_slope_px(self, t: Floats) -> Floats:
        """Pixels per radian along the image radius, f / cos^2(theta); t below 1."""
        slope: Floats = self.focal_length_px * np.square((1.0 + t * t) / ((1.0 - t) * (1.0 + t)))
        return slope

    @np.errstate(under="ignore")  # terms far below the largest component may vanish
    def pixel_from_direction(self, direction: Floats) -> tuple[Floats, Bools]:
        """Pixel of a direction, and whether the image contains the pixel.

        Args:
            direction: (..., 3) in the camera frame, of any length.

        Returns:
            (..., 2) pixels and a (...) mask. Valid directions lie ahead and within the image,
                borders included. Invalid pixels are the image centre, never NaN.
        """
        # Divided by the largest component, no product below can overflow or vanish.
        x, y, z = scale_components(direction)
        # Compare products instead of y / x: outside the image x may be arbitrarily small.
        extent = np.maximum(
            np.abs(y) * (2.0 * self.focal_length_px / self.width_px),
            np.abs(z) * (2.0 * self.focal_length_px / self.height_px),
        )
        valid = (x > 0.0) & (extent <= x)
        # Masked before the division, so that invalid directions raise no warning.
        px_per_unit = self.focal_length_px / np.where(valid, x, 1.0)
        u = np.where(valid, y, 0.0) * px_per_unit + 0.5 * self.width_px
        v = np.where(valid, z, 0.0) * px_per_unit + 0.5 * self.height_px
        return np.stack((u, v), axis=-1), valid

    @np.errstate(under="ignore")
    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Unit direction of a pixel, and whether the pixel lies in the image.

        Args:
            pixel: (..., 2), u right and v down.

        Returns:
            (..., 3) directions in the camera frame and a (...) mask. Valid pixels lie in the image,
                borders included; invalid ones have the direction +x.
        """
        pixel = np.asarray(pixel, dtype=np.float64)
        u, v = pixel[..., 0], pixel[..., 1]
        # NaN compares false, hence invalid. Axis by axis, without a stacked mask: a zoom evaluates
        # every sample of an image.
        valid = (u >= 0.0) & (u <= self.width_px) & (v >= 0.0) & (v <= self.height_px)
        y = np.where(valid, u - 0.5 * self.width_px, 0.0) / self.focal_length_px
        z = np.where(valid, v - 0.5 * self.height_px, 0.0) / self.focal_length_px
        norm = np.sqrt(1.0 + y * y + z * z)
        return np.stack((1.0 / norm, y / norm, z / norm), axis=-1), np.asarray(valid)
