"""Situations of the decision experiment: worlds, places that a robot can reach, and motions.

Places are cells of a grid that the robot's base can reach from a start of the world without a
contact, at any heading. Half of them are close to an obstacle, half in the open; all are drawn from
a seed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.explain import ZERO_VELOCITY, PlanarVelocity
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.obstacle_grid import (
    GROUND_CLEARANCE_M,
    build_obstacle_grid,
    rectangles_intersect,
)
from catoptra_server.startup import StartupConfig

# All bundled worlds, so that none is chosen for the result.
WORLDS = (
    "corridor",
    "four_legged_2006",
    "incidence_rings",
    "legacy",
    "rescue",
    "warehouse",
)
# Speeds of a P2AT: a metre a second is beyond its wheels.
MOTIONS: Mapping[str, PlanarVelocity] = {
    "at rest": ZERO_VELOCITY,
    "slow": PlanarVelocity(0.05, 0.0, 0.02),
    "driving": PlanarVelocity(0.6, 0.0, 0.1),
    "turning": PlanarVelocity(0.2, 0.0, 1.2),
}
# Fine enough for the corridor's doors, which leave 9 cm on either side of a turning base.
_CELL_M = 0.1
_CLEARANCE_M = 0.02
# Free ground beside the base of a place in the open.
_OPEN_CLEARANCE_M = 0.4
# Places that the scene's triangles are compared with at a time.
_BATCH = 2048


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a world."""

    world: str
    """Name of the bundled file."""
    number: int
    """Index among the places of the world; seed of the noise."""
    pose: PlanarPose
    is_near: bool
    """Whether an obstacle is close to the robot."""


def choose_places(
    world: str, startup: StartupConfig, num_places: int, *, seed: int
) -> tuple[Place, ...]:
    """Places of a world, near obstacles and in the open by turns.

    Args:
        world: Name of the bundled file.
        startup: Its content, with the robot.
        num_places: Number of places.
        seed: Seed of cells and headings.
    """
    near, in_the_open = _find_cells(startup)
    generator = np.random.default_rng((seed, *world.encode()))
    places = []
    for number in range(num_places):
        # A world without obstacles, or one that is narrow everywhere, has cells of one kind alone.
        is_near = bool(len(near)) and (number % 2 == 0 or not len(in_the_open))
        cells = near if is_near else in_the_open
        x_m, y_m = (
            cells[generator.integers(len(cells))] + generator.uniform(-1.0, 1.0, 2) * _CLEARANCE_M
        )
        yaw_rad = float(generator.uniform(-math.pi, math.pi))
        places.append(Place(world, number, PlanarPose(float(x_m), float(y_m), yaw_rad), is_near))
    return tuple(places)


def _find_cells(startup: StartupConfig) -> tuple[Floats, Floats]:
    """(n, 2) centres of reachable cells near obstacles, and (m, 2) of those in the open."""
    outlines = startup.scene.corners[..., :2]
    low, high = outlines.min(axis=(0, 1)), outlines.max(axis=(0, 1))
    columns, rows = (np.arange(a, b, _CELL_M) for a, b in zip(low, high, strict=True))
    centres = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1)
    flat = centres.reshape(-1, 2)
    is_free = _are_free(startup, flat, _CLEARANCE_M).reshape(centres.shape[:2])
    is_reachable = _flood(is_free, _start_cells(startup, low))
    reachable = centres[is_reachable]
    is_open = _are_free(startup, reachable, _OPEN_CLEARANCE_M)
    return reachable[~is_open], reachable[is_open]


def _start_cells(startup: StartupConfig, low: Floats) -> list[tuple[int, int]]:
    """Cells of the world's starts; that of the origin for a world without one."""
    locations = [start.location_m[:2] for start in startup.world.starts] or [(0.0, 0.0)]
    cells = np.rint((np.array(locations) - low) / _CELL_M).astype(int)
    return [(int(column), int(row)) for column, row in cells]


def _are_free(startup: StartupConfig, places: Floats, clearance_m: float) -> Bools:
    """(n,) whether the base of the robot has free ground around it at (n, 2) places."""
    robot: RobotDescription = startup.robots[0]
    length_m, width_m, height_m = robot.drive.collision_size_m
    height_m = max(robot.max_viewpoint_height_m, height_m)
    obstacles = build_obstacle_grid(startup.scene, low_m=GROUND_CLEARANCE_M, high_m=height_m)
    # A square about the circle that the base turns in: free at any heading.
    half_m = 0.5 * math.hypot(length_m, width_m) + clearance_m
    free = np.ones(len(places), dtype=bool)
    for begin in range(0, len(places), _BATCH):
        batch = places[begin : begin + _BATCH]
        middle = 0.5 * (batch.min(axis=0) + batch.max(axis=0))
        reach_m = float(np.abs(batch - middle).max()) + half_m
        x, y = middle.tolist()
        triangles = obstacles.triangles_near((x, y), reach_m)
        free[begin : begin + _BATCH] = ~rectangles_intersect(
            triangles, batch, 0.0, half_size_m=(half_m, half_m)
        )
    return free


def _flood(is_free: Bools, starts: list[tuple[int, int]]) -> Bools:
    """(n, m) free cells that are connected with a free start."""
    reached = np.zeros_like(is_free)
    waiting = [cell for cell in starts if is_free[cell]]
    for cell in waiting:
        reached[cell] = True
    while waiting:
        cell = waiting.pop()
        for neighbour in _neighbours(cell, is_free.shape):
            if is_free[neighbour] and not reached[neighbour]:
                reached[neighbour] = True
                waiting.append(neighbour)
    return reached


def _neighbours(cell: tuple[int, int], shape: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    """Cells that share a side with a cell."""
    for column, row in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        i, j = cell[0] + column, cell[1] + row
        if 0 <= i < shape[0] and 0 <= j < shape[1]:
            yield i, j
