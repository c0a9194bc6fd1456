"""Boxes on the sphere around the pixels of objects: intervals of azimuth and elevation, and cones.

Frame: the robot's axes at the camera, x ahead, y right, z down; a robot on a slope is not level.
Azimuth from x towards y, elevation towards the robot's top. Each pixel counts with its whole
square, as far as the camera's domain reaches: its centre, its corners and the middles of its edges,
between which a pixel's outline bends by less than a thousandth of its width. Of a mirror without a
viewpoint directions are those of its rays. A cone is an axis and a half angle of up to 180 degrees,
the smallest around the directions.

Boxes enclose the pixels' squares, not their centres, and are computed from the outlines alone, of
all objects at once. A pole inside an object means all azimuths; one on its outline is the end of
its elevations, and has no azimuth. Next to a pole an edge is an arc of a great circle, whose
highest point counts, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels.masks import Ids
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.elementary import arccos, arctan2, cos, dot, hypot, matmul, sin
from catoptra_protocol.optics.numerics import TWO_PI, Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass

_Indices = npt.NDArray[np.intp]
# Numbers of the objects that are seen in (n, 3) directions, 0 for nothing.
_LookUp = Callable[[Floats], npt.NDArray[Any]]
# Steps of the exact search, of which a dozen are usual; beyond, directions leave no half space.
_MAX_STEPS = 200
_CONE_ROUNDING = 1e-12
# Pairs and triples of four directions, the last of a pair twice.
_SUBSETS = np.array(
    [(*one, one[1]) for one in combinations(range(4), 2)] + [*combinations(range(4), 3)]
)
_NUM_PAIRS = 6
# Axes that are tried first where no half space holds all directions. No direction is farther from
# one of them; a seven of half the radius covers a circle.
_NUM_AXES = 500
_AXES_RADIUS_RAD = 0.16
_HALF = 0.51
_MIN_RADIUS_RAD = 1e-5
_MAX_AXES = 256


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

    Through two or three of them where a half space holds them all; else larger by at most
    0.00002 rad.
    """
    number, first = np.array([1]), np.zeros(1, dtype=np.intp)
    return _enclose_groups(directions, first, number, lambda axes: np.zeros(len(axes)))[0]


def _enclose_groups(
    directions: Floats, firsts: _Indices, numbers: npt.NDArray[Any], look_up: _LookUp
) -> list[BoundingCone]:
    """Smallest cone around each group of directions, found as Welzl's smallest ball, with the
    farthest direction next.

    Args:
        directions: (n, 3) unit, group by group: outlines of objects.
        firsts: (m,) place of each group's first.
        numbers: (m,) number of each group's object.
        look_up: Numbers that are seen in directions.
    """
    counts = np.diff(firsts, append=len(directions))
    basis = np.repeat(directions[firsts][:, None], 4, axis=1)
    axes, cosines = basis[:, 0].copy(), np.ones(len(firsts))
    active, some, num = np.arange(len(firsts)), directions.T.copy(), counts
    for _ in range(_MAX_STEPS):
        x, y, z = (np.repeat(one, num) for one in axes[active].T)
        products = x * some[0] + y * some[1] + z * some[2]
        farthest = _find_largest(-products, np.cumsum(num) - num)
        basis[active, 3] = some[:, farthest].T
        goes_on = products[farthest] < cosines[active] - _CONE_ROUNDING
        grown = active[goes_on]
        basis[grown, :3], axes[grown], cosines[grown] = _grow_bases(basis[grown])
        goes_on[goes_on] = cosines[grown] > 0.0
        if not goes_on.any():
            break
        active, some, num = active[goes_on], some[:, np.repeat(goes_on, num)], num[goes_on]
    else:
        cosines[active] = -2.0
    halves = _angles(basis[:, 3], axes)
    # An outline within a half space is that of what is within, or of all the rest.
    is_half = (cosines > 0.0) & (look_up(-axes) != numbers)
    return [
        BoundingCone(axes[group], float(halves[group]))
        if is_half[group]
        else _enclose_sphere(directions[first : first + counts[group]], numbers[group], look_up)
        for group, first in enumerate(firsts)
    ]


def _find_largest(values: Floats, firsts: _Indices) -> _Indices:
    """(m,) place of the largest value of each group, the first of equal ones."""
    largest = np.maximum.reduceat(values, firsts)
    is_largest = values == np.repeat(largest, np.diff(firsts, append=len(values)))
    places = np.flatnonzero(is_largest)
    return places[np.searchsorted(places, firsts)]


def _grow_bases(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Two or three of (n, 4, 3) directions whose cone holds all four, the smallest: (n, 3, 3), its
    (n, 3) axis, and its (n,) cosine, -2 without any."""
    chosen = points[:, _SUBSETS]
    first, second, third = (chosen[:, :, number] for number in range(3))
    axes = np.cross(second - first, third - first)
    axes *= np.where(dot(axes, first) < 0.0, -1.0, 1.0)[..., None]
    axes[:, :_NUM_PAIRS] = (first + second)[:, :_NUM_PAIRS]
    lengths = hypot(axes[..., 0], axes[..., 1], axes[..., 2])
    is_axis = lengths > _CONE_ROUNDING
    axes /= np.where(is_axis, lengths, 1.0)[..., None]
    products = dot(axes[:, :, None], points[:, None])
    cosines = np.take_along_axis(products, _SUBSETS[None], axis=2).min(axis=2)
    holds_all = (products >= cosines[..., None] - _CONE_ROUNDING).all(axis=2) & is_axis
    cosines = np.where(holds_all, cosines, -2.0)
    rows, best = np.arange(len(points)), np.argmax(cosines, axis=1)
    return chosen[rows, best], axes[rows, best], cosines[rows, best]


def _enclose_sphere(directions: Floats, number: int, look_up: _LookUp) -> BoundingCone:
    """Cone of more than 90 degrees: opposite to the largest circle without any direction.

    An axis in a circle of axes is at most the circle's radius farther from an outline than the
    middle: circles that cannot have the best are left out, others divided.
    """
    index = np.arange(0.5, _NUM_AXES)
    height = 1.0 - 2.0 * index / _NUM_AXES
    azimuth = math.pi * (1.0 + math.sqrt(5.0)) * index
    level = np.sqrt(1.0 - np.square(height))
    axes = np.column_stack((level * cos(azimuth), level * sin(azimuth), height))
    radius_rad = _AXES_RADIUS_RAD
    while True:
        distance = arccos(np.clip(matmul(axes, directions.T).max(axis=1), -1.0, 1.0))
        # Within the object the outline is the end of the wrong side.
        distance[look_up(axes) == number] *= -1.0
        order = np.argsort(-distance, kind="stable")[:_MAX_AXES]
        best = axes[order[0]]
        if radius_rad < _MIN_RADIUS_RAD:
            if distance[order[0]] <= _MIN_RADIUS_RAD:
                return BoundingCone(-best, math.pi)
            return BoundingCone(-best, float(_angles(directions, -best).max()))
        kept = axes[order[distance[order] >= distance[order[0]] - radius_rad]]
        axes, radius_rad = _divide(kept, radius_rad), _HALF * radius_rad


def _divide(axes: Floats, radius_rad: float) -> Floats:
    """(7 n, 3) middles of the circles of half the radius that cover circles around (n, 3) axes."""
    helper = np.where(np.abs(axes[:, :1]) < 0.6, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    across = np.cross(axes, helper)
    across /= hypot(across[:, 0], across[:, 1], across[:, 2])[:, None]
    other = np.cross(axes, across)
    turns = np.arange(6.0) * (math.pi / 3.0)
    step = 0.5 * math.sqrt(3.0) * radius_rad
    moved = axes[:, None] + step * (
        cos(turns)[:, None] * across[:, None] + sin(turns)[:, None] * other[:, None]
    )
    moved /= hypot(moved[..., 0], moved[..., 1], moved[..., 2])[..., None]
    return np.concatenate((axes, moved.reshape(-1, 3)))


def _angles(directions: Floats, axis: Floats) -> Floats:
    """(n,) angles from one axis or from (n, 3), exact for small and for large ones."""
    across = np.linalg.norm(directions - axis, axis=-1)
    along = np.linalg.norm(directions + axis, axis=-1)
    return np.asarray(2.0 * arctan2(across, along))


# A vertical direction on a border belongs to both pixels: relative to the largest product.
_BOX_ROUNDING = 1e-9
# Of half a pixel, to 1e-6 of it.
_BISECTIONS = 20
# Nearer to a pole a point has no azimuth.
_POLE_RAD = 1e-7
# An edge that spans more azimuths bends by 0.006 px and more.
_NEAR_POLE_RAD = 0.1
# Apart from each other by more than any end of an interval: keeps groups apart in one sum.
_GROUP_STEP = 16.0


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


ANYWHERE = SphericalBox(
    -math.pi,
    TWO_PI,
    -0.5 * math.pi,
    0.5 * math.pi,
    BoundingCone(np.array((0.0, 0.0, 1.0)), math.pi),
)
"""All directions."""


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
        self._camera, self._level_from_camera = camera, level_from_camera
        height, width = camera.height_px, camera.width_px
        u, v = 0.5 * np.arange(2 * width + 1), 0.5 * np.arange(2 * height + 1)
        points = np.stack(np.meshgrid(u, v), axis=-1)
        directions, valid = _look_up(camera, points)
        poles = matmul(np.array(((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))), level_from_camera)
        self._poles = [_find_pixels(directions, valid, pole) for pole in poles]
        moved = _move_to_domain(camera, points, valid)
        self._is_moved = ~valid.reshape(-1)
        directions[~valid], valid[~valid] = (one[~valid] for one in _look_up(camera, moved))
        self.directions: Floats = matmul(directions, level_from_camera.T)
        """(2 h + 1, 2 w + 1, 3) unit directions of a grid of half pixels, level axes; those beyond
        the camera's domain, but next to it, are of its border."""
        self.valid = valid
        """(2 h + 1, 2 w + 1) mask of those in the domain or next to it."""
        self._azimuth, self._elevation = angles_of(self.directions)

    def enclose(self, ids: Ids) -> dict[int, SphericalBox]:
        """Boxes around the pixels of all objects, by number; of (h, w) numbers, 0 for nothing."""
        owners, places = _find_edges(ids)
        is_known = self.valid.reshape(-1)[places].all(axis=1)
        owners, places = owners[is_known], places[is_known]
        if not owners.size:
            return {}
        firsts = np.flatnonzero(np.diff(owners, prepend=0))
        numbers = owners[firsts].tolist()
        azimuth, elevation = (one.reshape(-1)[places] for one in (self._azimuth, self._elevation))
        points = self.directions.reshape(-1, 3)
        begins, widths = _span_azimuths(azimuth, elevation)
        from_rad, widths_rad = _join_intervals(begins, widths, firsts)
        lowest = np.minimum(elevation[:, 0], elevation[:, 1])
        highest = np.maximum(elevation[:, 0], elevation[:, 1])
        near = np.flatnonzero(widths > _NEAR_POLE_RAD)
        lowest[near], highest[near] = _reach_arcs(points[places[near]], lowest[near], highest[near])
        low, high = np.minimum.reduceat(lowest, firsts), np.maximum.reduceat(highest, firsts)
        # An edge's end is the next one's begin; of the cone's points those of the rim alone have
        # another middle than the arc between.
        num = 1 + self._is_moved[places[:, 1]].astype(np.intp)
        ends = np.cumsum(num)
        chosen = np.repeat(places[:, 0], num)
        chosen[ends[num == 2] - 1] = places[num == 2, 1]
        cones = _enclose_groups(
            points[chosen],
            ends[firsts] - num[firsts],
            owners[firsts],
            partial(self._look_up_numbers, ids),
        )
        boxes = {}
        for row, number in enumerate(numbers):
            at_poles = [[ids[pixel] == number for pixel in pixels] for pixels in self._poles]
            is_around = any(pixels and all(pixels) for pixels in at_poles)
            boxes[number] = SphericalBox(
                -math.pi if is_around else float(from_rad[row]),
                TWO_PI if is_around else float(widths_rad[row]),
                -0.5 * math.pi if any(at_poles[0]) else float(low[row]),
                0.5 * math.pi if any(at_poles[1]) else float(high[row]),
                cones[row],
            )
        return boxes

    def _look_up_numbers(self, ids: Ids, directions: Floats) -> Ids:
        """Numbers of the pixels that show level directions; 0 where none does."""
        in_camera = matmul(directions, self._level_from_camera)
        if isinstance(self._camera, PerspectiveCamera):
            pixel, valid = self._camera.pixel_from_direction(in_camera)
        else:
            pixel, valid = pixel_from_direction(self._camera, in_camera)
        inside = valid & ((pixel >= 0.0) & (pixel < ids.shape[::-1])).all(axis=-1)
        column, row = np.where(inside[:, None], pixel, 0.0).astype(np.intp).T
        return np.where(inside, ids[row, column], np.uint16(0))


def _find_edges(ids: Ids) -> tuple[Ids, _Indices]:
    """Edges of the outlines of all objects: (n,) owners, ascending, and (n, 3) places of begin,
    middle and end in the grid of half pixels, row by row; each owner on an edge's right hand."""
    padded = np.pad(ids, 1)
    stride = 2 * ids.shape[1] + 1
    found = []
    for left, right, step in (
        (padded[:-1, 1:-1], padded[1:, 1:-1], 1),
        (padded[1:-1, 1:], padded[1:-1, :-1], stride),
    ):
        rows, columns = np.nonzero(left != right)
        places = 2 * (rows * stride + columns)[:, None] + step * np.arange(3)
        found.append((right[rows, columns], places))
        found.append((left[rows, columns], places[:, ::-1]))
    owners, places = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(owners, kind="stable")
    order = order[np.searchsorted(owners[order], 1) :]
    return owners[order], places[order]


def _span_azimuths(azimuth: Floats, elevation: Floats) -> tuple[Floats, Floats]:
    """(n,) begins, in [0, 2 pi), and widths of the azimuths of edges with (n, 3) points."""
    is_pole = 0.5 * math.pi - np.abs(elevation) < _POLE_RAD
    centre = np.where(is_pole[:, 1], azimuth[:, 0], azimuth[:, 1])
    offset = azimuth[:, ::2] - centre[:, None]
    offset -= TWO_PI * np.rint(offset / TWO_PI)
    # Beyond a pole the next edge goes on.
    offset[is_pole[:, ::2]] = 0.0
    offset[is_pole[:, 1], 1] = 0.0
    low = np.minimum(np.minimum(offset[:, 0], offset[:, 1]), 0.0)
    high = np.maximum(np.maximum(offset[:, 0], offset[:, 1]), 0.0)
    begins = centre + low
    return begins - TWO_PI * np.floor(begins / TWO_PI), high - low


def _reach_arcs(points: Floats, lowest: Floats, highest: Floats) -> tuple[Floats, Floats]:
    """(n,) lowest and highest elevations of edges with (n, 3, 3) points, with those of the arcs
    between the points."""
    for half in (0, 1):
        begin, end = points[:, half], points[:, half + 1]
        normal = np.cross(begin, end)
        is_between = np.cross(normal, begin)[:, 2] * np.cross(normal, end)[:, 2] < 0.0
        reach = arctan2(hypot(normal[:, 0], normal[:, 1]), np.abs(normal[:, 2]))
        is_up = begin[:, 2] < 0.0
        lowest = np.where(is_between & ~is_up, np.minimum(lowest, -reach), lowest)
        highest = np.where(is_between & is_up, np.maximum(highest, reach), highest)
    return lowest, highest


def _join_intervals(begins: Floats, widths: Floats, firsts: _Indices) -> tuple[Floats, Floats]:
    """(m,) begins and widths of the smallest interval around those of each group of azimuths.

    Args:
        begins: (n,) in [0, 2 pi], group by group.
        widths: (n,) up to 2 pi.
        firsts: (m,) place of each group's first.
    """
    counts = np.diff(firsts, append=len(begins))
    group = np.repeat(np.arange(len(firsts)), counts)
    # Stable: keys that round to one another would be in another order on another processor.
    order = np.argsort(begins + _GROUP_STEP * group, kind="stable")
    begins = begins[order]
    ends = np.maximum.accumulate(begins + widths[order] + _GROUP_STEP * group)
    ends -= _GROUP_STEP * group
    lasts = firsts + counts - 1
    # What passes the full turn covers azimuths from 0 on.
    ends = np.maximum(ends, ends[lasts][group] - TWO_PI)
    following = np.append(begins[1:], 0.0)
    following[lasts] = begins[firsts] + TWO_PI
    gaps = following - ends
    widest = _find_largest(gaps, firsts)
    begin = np.mod(following[widest] + math.pi, TWO_PI) - math.pi
    is_around = gaps[widest] <= 0.0
    return (
        np.where(is_around, -math.pi, begin),
        np.where(is_around, TWO_PI, TWO_PI - gaps[widest]),
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
