"""Boxes on the sphere around the pixels of objects: intervals of azimuth and elevation, and cones.

Frame: the robot's axes at the camera, x ahead, y right, z down; a robot on a slope is not level.
Azimuth from x towards y, elevation towards the robot's top. Each pixel counts with its whole
square, as far as the camera's domain reaches: its centre, its corners and the middles of its edges,
between which a pixel's outline bends by less than a thousandth of its width. Of a mirror without a
viewpoint directions are those of its rays. A cone is an axis and a half angle of up to 180 degrees,
the smallest around the directions.

Boxes enclose the pixels' squares, not their centres, and are computed from the boundary pixels
alone. A pole inside an object means all azimuths. Cones are exact where a half space holds the
object.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels.masks import Ids, ObjectMask
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.elementary import arctan2, cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import TWO_PI, Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass

# Steps of the exact search, of which a dozen are usual; beyond, directions leave no half space.
_MAX_STEPS = 200
_CONE_ROUNDING = 1e-12
# Axes tried where no half space holds all directions, then steps of a refinement.
_NUM_AXES = 2000
_NUM_REFINEMENTS = 300


@dataclass(frozen=True, slots=True, eq=False)
class BoundingCone:
    """Directions within an angle of an axis."""

    axis: Floats
    """(3,) unit."""
    half_angle_rad: float
    """Up to pi."""

    def contains(self, directions: Floats, margin_rad: float = 0.0) -> bool:
        """Whether all (n, 3) unit directions lie within the cone, widened by a margin."""
        return bool((_angles(directions, self.axis) <= self.half_angle_rad + margin_rad).all())


def enclose_directions(directions: Floats) -> BoundingCone:
    """Smallest cone around (n, 3) unit directions, n above 0.

    Exact where a half space holds them all: a cone through two or three of them, found as Welzl's
    smallest ball, with the farthest direction next. Else the best of many axes, refined: larger by
    some thousandths of a radian.
    """
    cone = _enclose_half_space(directions)
    return _enclose_sphere(directions) if cone is None else cone


def _enclose_half_space(directions: Floats) -> BoundingCone | None:
    """Smallest cone of at most 90 degrees; None if there is none."""
    first = directions[0]
    basis = [first, directions[int(np.argmin(matmul(directions, first)))]]
    axis = _normalize(basis[0] + basis[1])
    for _ in range(_MAX_STEPS):
        if axis is None:
            return None
        cosine = min(float(matmul(axis, one)) for one in basis)
        if cosine <= 0.0:
            return None
        cosines = matmul(directions, axis)
        farthest = int(np.argmin(cosines))
        if cosines[farthest] >= cosine - _CONE_ROUNDING:
            return BoundingCone(axis, float(_angles(directions, axis).max()))
        basis, axis = _grow_basis([*basis, directions[farthest]])
    return None


def _grow_basis(points: list[Floats]) -> tuple[list[Floats], Floats | None]:
    """Two or three of at most four directions whose cone holds them all, the smallest."""
    best: tuple[float, list[Floats], Floats | None] = (-2.0, points, None)
    for size in (2, 3):
        for chosen in combinations(points, size):
            axis = _axis_through(chosen)
            if axis is None:
                continue
            cosine = min(float(matmul(axis, one)) for one in chosen)
            holds_all = all(matmul(axis, one) >= cosine - _CONE_ROUNDING for one in points)
            if holds_all and cosine > best[0]:
                best = (cosine, list(chosen), axis)
    return best[1], best[2]


def _axis_through(points: tuple[Floats, ...]) -> Floats | None:
    """Axis of the smallest cone with two or three directions on its surface."""
    if len(points) == 2:
        return _normalize(points[0] + points[1])
    normal = _normalize(np.cross(points[1] - points[0], points[2] - points[0]))
    return None if normal is None else normal * math.copysign(1.0, float(matmul(normal, points[0])))


def _enclose_sphere(directions: Floats) -> BoundingCone:
    """Cone of more than 90 degrees: opposite to the largest empty cone."""
    index = np.arange(0.5, _NUM_AXES)
    height = 1.0 - 2.0 * index / _NUM_AXES
    azimuth = math.pi * (1.0 + math.sqrt(5.0)) * index
    level = np.sqrt(1.0 - np.square(height))
    axes = np.column_stack((level * cos(azimuth), level * sin(azimuth), height))
    smallest = np.array([float(matmul(directions, axis).min()) for axis in axes])
    axis, cosine = axes[int(np.argmax(smallest))], float(smallest.max())
    # A fixed seed: the same directions have the same cone.
    random = np.random.default_rng(0)
    step_rad = 2.0 / math.sqrt(_NUM_AXES)
    for _ in range(_NUM_REFINEMENTS):
        moved = axis + step_rad * math.sqrt(12.0) * (random.random(3) - 0.5)
        moved /= hypot(*moved)
        least = float(matmul(directions, moved).min())
        if least > cosine:
            axis, cosine = moved, least
        else:
            step_rad *= 0.98
    return BoundingCone(axis, float(_angles(directions, axis).max()))


def _angles(directions: Floats, axis: Floats) -> Floats:
    """(n,) angles from an axis, exact for small and for large ones."""
    across = np.linalg.norm(directions - axis, axis=-1)
    along = np.linalg.norm(directions + axis, axis=-1)
    return np.asarray(2.0 * arctan2(across, along))


def _normalize(vector: Floats) -> Floats | None:
    length = hypot(*vector)
    return None if length < _CONE_ROUNDING else np.asarray(vector / length)


# Positions of a pixel's points among those of a grid of half pixels.
_WINDOW = np.array([(row, column) for row in range(3) for column in range(3)])
# A vertical direction on a border belongs to both pixels: relative to the largest product.
_BOX_ROUNDING = 1e-9
# Of half a pixel, to 1e-6 of it.
_BISECTIONS = 20


@dataclass(frozen=True, slots=True, eq=False)
class SphericalBox:
    """Directions of an object's pixels."""

    azimuth_from_rad: float
    """Begin of the interval, in [-pi, pi)."""
    azimuth_width_rad: float
    """Width, clockwise from above; 2 pi: all around. The interval may pass pi."""
    elevation_from_rad: float
    elevation_to_rad: float
    cone: BoundingCone

    def contains(self, directions: Floats, margin_rad: float = 0.0) -> Bools:
        """(n,) whether the intervals hold (n, 3) directions, in the same frame."""
        azimuth, elevation = angles_of(directions)
        offset = np.mod(azimuth - self.azimuth_from_rad + margin_rad, TWO_PI)
        inside = (
            (offset <= self.azimuth_width_rad + 2.0 * margin_rad)
            & (elevation >= self.elevation_from_rad - margin_rad)
            & (elevation <= self.elevation_to_rad + margin_rad)
        )
        return np.asarray(inside)


def angles_of(directions: Floats) -> tuple[Floats, Floats]:
    """Azimuths in (-pi, pi] and elevations of (..., 3) directions of any length."""
    level = hypot(directions[..., 0], directions[..., 1])
    azimuth = arctan2(directions[..., 1], directions[..., 0])
    return azimuth, arctan2(-directions[..., 2], level)


class PixelSphere:
    """Directions of all points of a camera's pixels, computed once for many images."""

    def __init__(
        self, camera: OmniCamera | PerspectiveCamera, level_from_camera: npt.NDArray[np.float64]
    ) -> None:
        """Compute all directions.

        Args:
            camera: The camera.
            level_from_camera: (3, 3) rotation of the mirror frame, or of an ordinary camera's, on
                the robot.
        """
        height, width = camera.height_px, camera.width_px
        u, v = 0.5 * np.arange(2 * width + 1), 0.5 * np.arange(2 * height + 1)
        points = np.stack(np.meshgrid(u, v), axis=-1)
        directions, valid = _look_up(camera, points)
        poles = matmul(np.array(((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))), level_from_camera)
        self._poles = [_find_pixels(directions, valid, pole) for pole in poles]
        moved = _move_to_domain(camera, points, valid)
        directions[~valid], valid[~valid] = (one[~valid] for one in _look_up(camera, moved))
        self.directions: Floats = matmul(directions, level_from_camera.T)
        """(2 h + 1, 2 w + 1, 3) unit directions of a grid of half pixels, level axes; those beyond
        the camera's domain, but next to it, are of its border."""
        self.valid = valid
        """(2 h + 1, 2 w + 1) mask of those in the domain or next to it."""
        self._azimuth, self._elevation = angles_of(self.directions)

    def enclose(self, ids: Ids, mask: ObjectMask) -> SphericalBox:
        """Box around the pixels of an object.

        Args:
            ids: (h, w) numbers of the image.
            mask: Pixels of the object.
        """
        rows, columns = _boundary(ids, mask)
        grid_rows = 2 * rows[:, None] + _WINDOW[:, 0]
        grid_columns = 2 * columns[:, None] + _WINDOW[:, 1]
        valid = self.valid[grid_rows, grid_columns]
        azimuth = self._azimuth[grid_rows, grid_columns]
        elevation = self._elevation[grid_rows, grid_columns][valid]
        below, above = (
            any(ids[row, column] == mask.number for row, column in pixels) for pixels in self._poles
        )
        begin, width = -math.pi, TWO_PI
        if not (below or above):
            begin, width = _enclose_azimuths(azimuth, valid)
        points = self.directions[grid_rows, grid_columns][valid]
        return SphericalBox(
            begin,
            width,
            -0.5 * math.pi if below else float(elevation.min()),
            0.5 * math.pi if above else float(elevation.max()),
            enclose_directions(points),
        )


def _look_up(
    camera: OmniCamera | PerspectiveCamera, points: Floats
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Directions in the camera's frame of (..., 2) points of the image, and validity."""
    if isinstance(camera, PerspectiveCamera):
        return camera.direction_from_pixel(points)
    _, directions, valid = ray_from_pixel(camera, points)
    return directions, valid


def _move_to_domain(camera: OmniCamera | PerspectiveCamera, points: Floats, valid: Bools) -> Floats:
    """Points of the grid; those next to the camera's domain are moved to its border."""
    moved = points.copy()
    inside = np.full(points.shape, np.nan)
    padded = np.pad(valid, 2)
    rows, columns = valid.shape
    window = [(row, column) for row in range(-2, 3) for column in range(-2, 3)]
    # The nearest point first.
    steps = sorted(window, key=lambda step: step[0] ** 2 + step[1] ** 2)
    for row_step, column_step in steps:
        there = padded[2 + row_step :, 2 + column_step :][:rows, :columns]
        takes = ~valid & there & np.isnan(inside[..., 0])
        inside[takes] = points[takes] + 0.5 * np.array((column_step, row_step))
    near = np.isfinite(inside[..., 0])
    low, high = inside[near], points[near]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        holds = _look_up(camera, middle)[1][:, None]
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    moved[near] = low
    return moved


def _find_pixels(directions: Floats, valid: Bools, pole: Floats) -> list[tuple[int, int]]:
    """Row and column of the pixels whose squares hold a direction; several on a common border."""
    corners = directions[::2, ::2]
    # On one side of all four edges, seen along the direction: then it lies in the square.
    across = matmul(np.cross(corners[:, :-1], corners[:, 1:]), pole)
    along = matmul(np.cross(corners[:-1], corners[1:]), pole)
    sides = np.stack((across[:-1], along[:, 1:], -across[1:], -along[:, :-1]))
    is_ahead = matmul(directions[1::2, 1::2], pole) > 0.0
    shown = valid[::2, ::2]
    whole = shown[:-1, :-1] & shown[1:, 1:] & shown[:-1, 1:] & shown[1:, :-1]
    slack = _BOX_ROUNDING * np.abs(across).max(initial=0.0)
    holds = ((sides >= -slack).all(axis=0) | (sides <= slack).all(axis=0)) & is_ahead & whole
    return [(int(row), int(column)) for row, column in np.argwhere(holds)]


def _boundary(ids: Ids, mask: ObjectMask) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Rows and columns of those pixels of a mask that have a neighbour of another number."""
    rows, columns = mask.rows, mask.columns
    height, width = ids.shape
    differs = (rows == 0) | (rows == height - 1) | (columns == 0) | (columns == width - 1)
    for row_step, column_step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        there = ids[
            np.clip(rows + row_step, 0, height - 1), np.clip(columns + column_step, 0, width - 1)
        ]
        differs |= there != mask.number
    return rows[differs], columns[differs]


def _enclose_azimuths(azimuth: Floats, valid: Bools) -> tuple[float, float]:
    """Begin and width of the smallest interval around the azimuths of (n, 9) points of pixels."""
    # Relative to each pixel's centre, which is valid: without a pole a pixel spans less than pi.
    centre = azimuth[:, 4:5]
    offset = np.where(valid, np.mod(azimuth - centre + math.pi, TWO_PI) - math.pi, 0.0)
    begins = np.mod(centre[:, 0] + offset.min(axis=1), TWO_PI)
    ends = begins + (offset.max(axis=1) - offset.min(axis=1))
    order = np.argsort(begins, kind="stable")
    begins, ends = begins[order], np.maximum.accumulate(ends[order])
    # What passes the full turn covers azimuths from 0 on.
    ends = np.maximum(ends, ends[-1] - TWO_PI)
    gaps = np.append(begins[1:], begins[0] + TWO_PI) - ends
    widest = int(np.argmax(gaps))
    if gaps[widest] <= 0.0:
        return -math.pi, TWO_PI
    begin = float(begins[(widest + 1) % len(begins)])
    wrapped = math.remainder(begin, TWO_PI)
    return (-math.pi if wrapped == math.pi else wrapped), TWO_PI - float(gaps[widest])
