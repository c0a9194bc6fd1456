"""Blobs: connected regions of one colour in a labelled cylinder, joined across the seam.

The effective viewpoint on the robot, from which a cylinder is seen, is here too, with the
conversion of its poses and polar coordinates to those of the robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_client.landmarks.classifier import COLOUR_CODES, UInt8Array
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy

# On one thread OpenCV's default algorithm takes three times as long. Measured in
# tests/measurements/detection_time.py.
_CCL_ALGORITHM = cv2.CCL_GRANA
_MAX_REGIONS = 2**16

_Ints = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True, slots=True)
class Blob:
    """Connected region of one colour: size, centroid and bounding box.

    Columns and rows are continuous, pixel centres at +0.5. A blob across the seam continues beyond
    the width of the image: right > columns.
    """

    colour: str
    """Landmark colour, a name in `BAND_COLOURS`."""
    num_pixels: int
    column: float
    row: float
    left: float
    right: float
    top: float
    bottom: float

    @property
    def width(self) -> float:
        """Width of the bounding box, in columns."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Height of the bounding box, in rows."""
        return self.bottom - self.top


def blobs_from_labels(labels: UInt8Array, *, min_pixels: int) -> tuple[Blob, ...]:
    """Blobs of at least `min_pixels` in a (rows, columns) image of colour codes."""
    # Rows without a colour are left out once for all of them: landmarks fill few rows.
    _, top, _, height = cv2.boundingRect(labels)
    rows = labels[top : top + height]
    blobs = [
        blob
        for colour, code in COLOUR_CODES.items()
        if height
        for blob in _find_blobs(colour, cv2.inRange(rows, code, code), first_row=top)
    ]
    return tuple(blob for blob in blobs if blob.num_pixels >= min_pixels)


def _find_blobs(colour: str, mask: UInt8Array, *, first_row: int) -> list[Blob]:
    # Only the rectangle that has the colour is labelled: the cost is that of the pixels, a tenth of
    # the image's in a frame of the field.
    left, top, width, height = cv2.boundingRect(mask)
    if not width:
        return []
    part = mask[top : top + height, left : left + width]
    # A region and the gap to the next fill 2 x 2 px: numbers of 16 bits, if enough, halve the time.
    is_small = (width + 1) * (height + 1) // 4 < _MAX_REGIONS
    _, regions, stats, centroids = cv2.connectedComponentsWithStatsWithAlgorithm(
        part, 8, cv2.CV_16U if is_small else cv2.CV_32S, _CCL_ALGORITHM
    )
    boxes = (stats + np.array([left, first_row + top, 0, 0, 0])).tolist()
    centres = (centroids + np.array([left + 0.5, first_row + top + 0.5])).tolist()
    blobs = {
        i: Blob(colour, pixels, column, row, x, x + w, y, y + h)
        for i, ((x, y, w, h, pixels), (column, row)) in enumerate(zip(boxes, centres, strict=True))
        if i  # 0 is the background
    }
    # A narrower rectangle does not reach both sides of the seam.
    if width == mask.shape[1]:
        for first, last in _find_seam_pairs(np.asarray(regions)):
            _join_across_seam(blobs, first, last, columns=width)
    # Joined regions share one blob object: identity removes the duplicates in order.
    return list({id(blob): blob for blob in blobs.values()}.values())


def _find_seam_pairs(regions: _Ints) -> Iterator[tuple[int, int]]:
    """Yield pairs of regions that touch across the seam, diagonals included."""
    first, last = regions[:, 0], regions[:, -1]
    if not (first.any() and last.any()):
        return
    # Shifts of the padded column by 0, 1, 2 compare each row with its three neighbours.
    padded = np.pad(last, 1)
    rows = len(first)
    pairs = {
        pair
        for shift in range(3)
        for pair in zip(first.tolist(), padded[shift : shift + rows].tolist(), strict=True)
    }
    # Sorted, so that the order of merges, and of floating-point sums, does not depend on hashes.
    yield from sorted(pair for pair in pairs if all(pair))


def _join_across_seam(blobs: dict[int, Blob], first: int, last: int, *, columns: int) -> None:
    """Merge two regions: the last column's, continued by the first column's.

    Both region numbers then refer to the merged blob. Regions that are joined already, or run
    around the whole turn, stay unchanged.
    """
    # The last column is the left part: azimuth grows to the right and continues past the seam.
    head, tail = blobs[last], blobs[first]
    if head is tail:
        return
    joined = _merge(head, tail if tail.right > columns else _shift(tail, columns))
    for region, blob in blobs.items():
        if blob is head or blob is tail:
            blobs[region] = joined


def _shift(blob: Blob, columns: int) -> Blob:
    return replace(
        blob,
        column=blob.column + columns,
        left=blob.left + columns,
        right=blob.right + columns,
    )


def _merge(one: Blob, other: Blob) -> Blob:
    pixels = one.num_pixels + other.num_pixels
    fraction = other.num_pixels / pixels
    return Blob(
        one.colour,
        pixels,
        one.column + fraction * (other.column - one.column),
        one.row + fraction * (other.row - one.row),
        min(one.left, other.left),
        max(one.right, other.right),
        min(one.top, other.top),
        max(one.bottom, other.bottom),
    )


# Bound of the relative error of a coordinate: roundings of sine, cosine, product and sum.
_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Position of the effective viewpoint on the robot, and how the camera is mounted there."""

    height_m: float = 0.6
    """Height above the floor, > 0. The paper gives no height; 0.6 m is assumed."""
    forward_m: float = 0.0
    """Offset along the robot's x axis."""
    right_m: float = 0.0
    """Offset along the robot's y axis."""
    rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the mirror frame on the robot; 0 for a mirror and a hanging lens."""

    def __post_init__(self) -> None:
        numbers = (self.height_m, self.forward_m, self.right_m, *self.rpy_rad)
        if not (all(map(math.isfinite, numbers)) and self.height_m > 0.0):
            raise DomainError(f"a viewpoint is finite and above the floor: {numbers}")

    @classmethod
    def from_mount(cls, robot_from_mirror: Pose, *, floor_from_robot_m: float = 0.0) -> Viewpoint:
        """Viewpoint of a camera that is mounted on a robot.

        Args:
            robot_from_mirror: Pose of the mirror frame on the robot, as frames of the stream have.
            floor_from_robot_m: Height of the robot's origin above the floor.
        """
        x, y, z = robot_from_mirror.translation.tolist()
        return cls(floor_from_robot_m - z, x, y, robot_from_mirror.to_rpy())

    @property
    def is_turned(self) -> bool:
        """Whether the mirror frame's axes differ from the robot's."""
        return self.rpy_rad != (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> Floats | None:
        """(3, 3) rotation of the mirror frame on the robot; None for none."""
        return rotation_from_rpy(*self.rpy_rad) if self.is_turned else None


def world_from_mirror(viewpoint: Viewpoint, robot_pose: Floats) -> Pose:
    """Pose of the mirror frame for a robot at (3,) x, y, yaw on the floor z = 0."""
    robot = Pose.from_rpy((robot_pose[0], robot_pose[1], 0.0), (0.0, 0.0, robot_pose[2]))
    offset = (viewpoint.forward_m, viewpoint.right_m, -viewpoint.height_m)
    return robot @ Pose.from_rpy(offset, viewpoint.rpy_rad)


def robot_from_viewpoint_polar(viewpoint: Viewpoint, polar: Floats) -> tuple[float, float, Floats]:
    """Polar coordinates around the robot's origin of a point measured from the viewpoint.

    Args:
        viewpoint: position of the viewpoint on the robot.
        polar: (2,) level range and azimuth from the viewpoint.

    Returns:
        Range, bearing, and their (2, 2) Jacobian with respect to `polar`.

    Raises:
        DomainError: the point is the robot's origin, where the bearing is undefined.
    """
    # Without an offset nothing is rounded: range and bearing pass through bit by bit.
    if viewpoint.forward_m == 0.0 and viewpoint.right_m == 0.0:
        return float(polar[0]), float(polar[1]), np.eye(2)
    reach, azimuth = float(polar[0]), float(polar[1])
    x = viewpoint.forward_m + reach * math.cos(azimuth)
    y = viewpoint.right_m + reach * math.sin(azimuth)
    range_m, bearing = math.hypot(x, y), math.atan2(y, x)
    # The sum has an absolute rounding error of the size of its terms; a smaller range is noise.
    if range_m <= _ROUNDING * reach:
        raise DomainError(f"{reach!r} m at {azimuth!r} rad is the robot's origin: no bearing")
    cos_d, sin_d = math.cos(azimuth - bearing), math.sin(azimuth - bearing)
    jacobian = np.array([[cos_d, -reach * sin_d], [sin_d / range_m, reach * cos_d / range_m]])
    return range_m, bearing, jacobian
