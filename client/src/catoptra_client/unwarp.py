"""Unwarping: from the mirror's disc to a cylinder around the viewpoint, or to a pinhole's picture.

The geometry is a frozen description; its map is computed once, in float64 from the camera law, and
kept as OpenCV's fixed-point map (1/32 px, by which INTER_LINEAR interpolates in any case); a frame
then costs one remap. A single effective viewpoint is what makes both exact (Schmits & Visser 2009,
section 2.1). This module does not know what is in the pictures.

| picture     | column                                 | row                                  |
|-------------|----------------------------------------|--------------------------------------|
| cylinder    | azimuth (x towards y), one full turn   | depression's tangent, z / hypot(x, y) |
| perspective | a pinhole's u                          | a pinhole's v                        |

Both show the world as a person would see it: azimuth grows to the right, so the mirror's reversal
of left and right is undone.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import TWO_PI, Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, opencv_from_pixel, pixel_from_direction
from catoptra_protocol.optics.transforms import rotation_from_rpy

UInt8Array = npt.NDArray[np.uint8]

# One number or an array of them: the cylinder's rulers serve both.
_FloatOrArray = TypeVar("_FloatOrArray", float, Floats)

# cv2.remap addresses source and target with 16-bit signed integers.
_MAX_SIDE_PX = 32767


@dataclass(frozen=True, slots=True)
class CylinderGeometry:
    """An unrolled cylinder around the vertical through the viewpoint.

    Rows are linear in the slope y = -tan(elevation), positive below the horizon: a point at height
    z and level distance r seen from height H has y = (H - z) / r, so heights on an upright object
    are linear in rows and its centroid is not pulled to either end. Columns are linear in azimuth
    over one full turn from `seam_azimuth_rad`, where the first column begins and the last ends;
    behind the robot unless told otherwise. Edges are whole numbers, centres at +0.5.
    """

    columns: int
    rows: int
    top_slope: float
    bottom_slope: float
    seam_azimuth_rad: float = -math.pi

    def __post_init__(self) -> None:
        _check_size(self.columns, self.rows)
        numbers = (self.top_slope, self.bottom_slope, self.seam_azimuth_rad)
        if not (all(map(math.isfinite, numbers)) and self.top_slope < self.bottom_slope):
            raise DomainError(f"a cylinder needs finite slopes, the top one smaller: {numbers}")
        if not 0.0 < self.slope_per_row < math.inf:
            raise DomainError(f"rows of a height that float64 cannot hold: {numbers}")

    @property
    def azimuth_per_column_rad(self) -> float:
        """Return the width of a column."""
        return TWO_PI / self.columns

    @property
    def slope_per_row(self) -> float:
        """Return the height of a row."""
        return (self.bottom_slope - self.top_slope) / self.rows

    def azimuth_from_column(self, column: _FloatOrArray) -> _FloatOrArray:
        """Return azimuths of (...) columns, not wrapped: it grows along the picture."""
        return self.seam_azimuth_rad + self.azimuth_per_column_rad * column

    def column_from_azimuth(self, azimuth_rad: Floats | float) -> Floats:
        """Return (...) columns in [0, columns) of azimuths, whatever turn they are given in.

        Raises DomainError, with the mask, for azimuths that are not finite.
        """
        finite = np.isfinite(azimuth_rad)
        if not np.all(finite):
            raise DomainError("an azimuth that is not finite has no column", valid_mask=finite)
        turned = np.mod(azimuth_rad - self.seam_azimuth_rad, TWO_PI) / self.azimuth_per_column_rad
        # mod of a tiny negative number rounds up to the whole turn, which is column 0 again.
        return np.where(turned < self.columns, turned, 0.0)

    def slope_from_row(self, row: _FloatOrArray) -> _FloatOrArray:
        """Return slopes of (...) rows."""
        return self.top_slope + self.slope_per_row * row

    def row_from_slope(self, slope: _FloatOrArray) -> _FloatOrArray:
        """Return (...) rows of slopes; those above or below the picture lie outside its rows."""
        return (slope - self.top_slope) / self.slope_per_row

    def directions(self) -> Floats:
        """Return (rows, columns, 3) directions of the pixel centres in the mirror frame."""
        azimuth = self.azimuth_from_column(np.arange(self.columns, dtype=np.float64) + 0.5)
        slope = self.slope_from_row(np.arange(self.rows, dtype=np.float64) + 0.5)
        parts = np.broadcast_arrays(np.cos(azimuth), np.sin(azimuth), slope[:, None])
        return np.stack(parts, axis=-1)


@dataclass(frozen=True, slots=True)
class PerspectiveGeometry:
    """A virtual pinhole camera at the viewpoint: square pixels, axis through the middle.

    yaw_rad: to the right of the robot's x. pitch_rad: nose up, as SAE counts it; a look at the
    floor is negative. width_rad: horizontal field of view, below a half turn.
    """

    width_px: int
    height_px: int
    horizontal_fov_rad: float
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0

    def __post_init__(self) -> None:
        _check_size(self.width_px, self.height_px)
        if not 0.0 < self.horizontal_fov_rad < math.pi:
            raise DomainError(
                f"a pinhole sees more than 0 and less than pi: {self.horizontal_fov_rad!r}"
            )
        if not (math.isfinite(self.yaw_rad) and math.isfinite(self.pitch_rad)):
            raise DomainError(f"angles must be finite: {self.yaw_rad!r}, {self.pitch_rad!r}")
        # The quotient of focal_px must not overflow, nor divide by a tangent of zero.
        if 0.5 * self.width_px > math.tan(0.5 * self.horizontal_fov_rad) * sys.float_info.max:
            raise DomainError(
                f"a view {self.horizontal_fov_rad!r} rad wide needs an infinite focal length"
            )

    @property
    def focal_length_px(self) -> float:
        """Return the focal length."""
        return 0.5 * self.width_px / math.tan(0.5 * self.horizontal_fov_rad)

    def directions(self) -> Floats:
        """Return (height, width, 3) directions of the pixel centres in the mirror frame."""
        right = np.arange(self.width_px) + 0.5 - 0.5 * self.width_px
        down = np.arange(self.height_px) + 0.5 - 0.5 * self.height_px
        parts = np.broadcast_arrays(self.focal_length_px, right, down[:, None])
        rotation = rotation_from_rpy(0.0, self.pitch_rad, self.yaw_rad)
        directions: Floats = np.stack(parts, axis=-1) @ rotation.T
        return directions


@dataclass(frozen=True, slots=True, eq=False)
class UnwarpMap:
    """Where each target pixel comes from: a fixed-point map, and which pixels the mirror sees.

    integer_px (h, w, 2) int16 and fraction (h, w) uint16 as cv2.convertMaps makes them; valid (h, w).
    source_shape: (height, width) of the frames it is made for.
    """

    integer_px: npt.NDArray[np.int16]
    fraction: npt.NDArray[np.uint16]
    valid: Bools
    source_shape: tuple[int, int]

    def __post_init__(self) -> None:
        for array in (self.integer_px, self.fraction, self.valid):
            array.setflags(write=False)


def make_unwarp_map(
    camera: OmniCamera, geometry: CylinderGeometry | PerspectiveGeometry
) -> UnwarpMap:
    """Return the map from a camera's frames to a geometry's picture.

    Valid: the mirror sees the pixel's centre and the frame reaches there. Elsewhere the picture is
    black.
    """
    _check_size(camera.width_px, camera.height_px)
    pixel, seen = pixel_from_direction(camera, geometry.directions())
    size = np.array([camera.width_px, camera.height_px], dtype=np.float64)
    valid = seen & ((pixel >= 0.0) & (pixel <= size)).all(axis=-1)
    # Two pixels outside: no tap of the interpolation reaches the frame, the border's black remains.
    source = np.where(valid[..., None], opencv_from_pixel(pixel), -2.0).astype(np.float32)
    whole, fraction = cv2.convertMaps(source[..., 0], source[..., 1], cv2.CV_16SC2)
    shape = (camera.height_px, camera.width_px)
    return UnwarpMap(np.asarray(whole), np.asarray(fraction), valid, shape)


def unwarp(frame: UInt8Array, unwarp_map: UnwarpMap) -> UInt8Array:
    """Return the (h, w, 3) picture of an omnidirectional (h, w, 3) RGB frame; bilinear."""
    if frame.dtype != np.uint8 or frame.shape != (*unwarp_map.source_shape, 3):
        height, width = unwarp_map.source_shape
        raise DomainError(
            f"the map is for RGB frames of {width} x {height} px, not {frame.dtype} {frame.shape}"
        )
    picture = cv2.remap(frame, unwarp_map.integer_px, unwarp_map.fraction, cv2.INTER_LINEAR)
    return np.asarray(picture, dtype=np.uint8)


def _check_size(width_px: int, height_px: int) -> None:
    if not (1 <= width_px <= _MAX_SIDE_PX and 1 <= height_px <= _MAX_SIDE_PX):
        raise DomainError(
            f"a picture has 1 to {_MAX_SIDE_PX} px a side, not {width_px} x {height_px}"
        )
