"""Smallest cone around directions: an axis and a half angle of up to 180 degrees."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass

# Steps of the exact search, of which a dozen are usual; beyond, directions leave no half space.
_MAX_STEPS = 200
_ROUNDING = 1e-12
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
    basis = [first, directions[int(np.argmin(directions @ first))]]
    axis = _normalize(basis[0] + basis[1])
    for _ in range(_MAX_STEPS):
        if axis is None:
            return None
        cosine = min(float(axis @ one) for one in basis)
        if cosine <= 0.0:
            return None
        cosines = directions @ axis
        farthest = int(np.argmin(cosines))
        if cosines[farthest] >= cosine - _ROUNDING:
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
            cosine = min(float(axis @ one) for one in chosen)
            holds_all = all(axis @ one >= cosine - _ROUNDING for one in points)
            if holds_all and cosine > best[0]:
                best = (cosine, list(chosen), axis)
    return best[1], best[2]


def _axis_through(points: tuple[Floats, ...]) -> Floats | None:
    """Axis of the smallest cone with two or three directions on its surface."""
    if len(points) == 2:
        return _normalize(points[0] + points[1])
    normal = _normalize(np.cross(points[1] - points[0], points[2] - points[0]))
    return None if normal is None else normal * math.copysign(1.0, float(normal @ points[0]))


def _enclose_sphere(directions: Floats) -> BoundingCone:
    """Cone of more than 90 degrees: opposite to the largest empty cone."""
    index = np.arange(_NUM_AXES) + 0.5
    height = 1.0 - 2.0 * index / _NUM_AXES
    azimuth = math.pi * (1.0 + math.sqrt(5.0)) * index
    level = np.sqrt(1.0 - np.square(height))
    axes = np.column_stack((level * np.cos(azimuth), level * np.sin(azimuth), height))
    smallest = np.array([float((directions @ axis).min()) for axis in axes])
    axis, cosine = axes[int(np.argmax(smallest))], float(smallest.max())
    # A fixed seed: the same directions have the same cone.
    random = np.random.default_rng(0)
    step_rad = 2.0 / math.sqrt(_NUM_AXES)
    for _ in range(_NUM_REFINEMENTS):
        moved = axis + step_rad * random.standard_normal(3)
        moved /= np.linalg.norm(moved)
        least = float((directions @ moved).min())
        if least > cosine:
            axis, cosine = moved, least
        else:
            step_rad *= 0.98
    return BoundingCone(axis, float(_angles(directions, axis).max()))


def _angles(directions: Floats, axis: Floats) -> Floats:
    """(n,) angles from an axis, exact for small and for large ones."""
    across = np.linalg.norm(directions - axis, axis=-1)
    along = np.linalg.norm(directions + axis, axis=-1)
    return np.asarray(2.0 * np.arctan2(across, along))


def _normalize(vector: Floats) -> Floats | None:
    length = float(np.linalg.norm(vector))
    return None if length < _ROUNDING else np.asarray(vector / length)
