"""Class, place and name of a new robot, from the parameters of INIT.

A robot is spawned where it touches nothing: a base in contact could hardly move, and robots inside
each other fill each other's images. A place that is not free is replaced by the nearest free one of
the same heading, within 8 m.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.names import list_names
from catoptra_protocol.optics.elementary import cos, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats, wrap_angle
from catoptra_protocol.usarsim.commands import Init
from catoptra_protocol.usarsim.reports import StartPose
from catoptra_server.simulation.drive import RobotBody
from catoptra_server.simulation.ground import NoStandError
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription


class Places(Protocol):
    """Where robots of a class stand, among the present ones."""

    def place(
        self,
        description: RobotDescription,
        pose: PlanarPose,
        z_m: float = 0.0,
        *,
        clearance_m: float = 0.0,
        robots: Iterable[Robot] = (),
    ) -> RobotBody:
        """Base at rest at a place; raises NoStandError."""

    def may_stand(
        self,
        description: RobotDescription,
        places: Floats,
        yaw_rad: float,
        z_m: float,
        clearance_m: float,
        robots: Iterable[Robot],
    ) -> Bools:
        """(n,) whether a test of places, (n, 2), is worth while."""


class SpawnError(CatoptraError):
    """INIT spawns no robot; the message is the reason, in words for the client."""


def place_robot(
    init: Init,
    classes: Sequence[RobotDescription],
    starts: Sequence[StartPose],
    ground: Places,
    robots: Collection[Robot],
) -> tuple[RobotDescription, RobotBody, bool]:
    """Class of a new robot, its base, and whether that stands elsewhere than requested.

    The base stands at the requested place if it can, else at the nearest one with room within 8 m.

    Args:
        init: The request.
        classes: Classes that it may name.
        starts: Start places that it may name.
        ground: What robots stand on.
        robots: Present robots.

    Raises:
        SpawnError: No class, start or free place answers to INIT.
    """
    description = find_class(classes, init.class_name)
    requested, z_m = _spawn_pose(init, starts)
    try:
        body = ground.place(description, requested, z_m, robots=robots)
    except NoStandError as error:
        return description, _find_place(description, requested, z_m, ground, robots, error), True
    wheels_m = float(body.world_from_robot.translation[2]) + description.drive.ride_height_m
    return description, body, not -_NEAR_M <= wheels_m - z_m <= _FAR_BELOW_M


def find_class(classes: Sequence[RobotDescription], name: str) -> RobotDescription:
    """First class of a name in any case, with or without the package.

    Raises:
        SpawnError: There is none.
    """
    for known in classes:
        if name.lower() in (known.class_name.lower(), known.model_name.lower()):
            return known
    names = list_names(name, (known.class_name for known in classes))
    raise SpawnError(f"there is no class {name!r}: this server has {names}")


def unique_name(requested: str, existing: Collection[str]) -> str:
    """Requested name, followed by the smallest number from 2 that makes the name unique."""
    if requested not in existing:
        return requested
    # Among n + 1 candidates at least one is not among n existing names.
    numbered = (f"{requested}{number}" for number in range(2, len(existing) + 3))
    return next(name for name in numbered if name not in existing)


# As far as landmarks may lie. The scene is drawn in float32, which rounds coordinates of 1e5 m to
# 8 mm; a place beyond 1e18 m has no cell number in 64 bits.
_MAX_COORDINATE_M = 1e5
# Far above any number of turns that a client could mean, and still wrapped to 1e-10 rad.
_MAX_ANGLE_RAD = 1e6


def _spawn_pose(init: Init, starts: Sequence[StartPose]) -> tuple[PlanarPose, float]:
    """Requested pose of a new robot, and z; the location precedes the start.

    Roll and pitch of either are ignored: they follow from what the base stands on.

    Raises:
        SpawnError: There is no such start, or the place is out of limits.
    """
    if init.location_m is not None:
        location_m, rotation_rad = init.location_m, init.rotation_rad
    else:
        start = _find_start(init.start, starts)
        location_m, rotation_rad = start.location_m, start.rotation_rad
    _check_limits("Location", location_m, _MAX_COORDINATE_M)
    _check_limits("Rotation", rotation_rad, _MAX_ANGLE_RAD)
    x_m, y_m, z_m = location_m
    return PlanarPose(x_m, y_m, wrap_angle(rotation_rad[2])), z_m


def _find_start(name: str | None, starts: Sequence[StartPose]) -> StartPose:
    # The first start of the name wins, as for classes.
    for start in starts:
        if name is not None and start.name.lower() == name.lower():
            return start
    names = list_names(name or "", (start.name for start in starts))
    what = "a robot needs a start or a Location" if name is None else f"there is no start {name!r}"
    raise SpawnError(f"{what}: this world has {names}")


def _check_limits(key: str, values: tuple[float, float, float], limit: float) -> None:
    # A comparison with NaN is false: it is out of limits, too.
    if not all(abs(value) <= limit for value in values):
        text = ",".join(f"{value:g}" for value in values)
        raise SpawnError(f"{key} {text} is out of limits: each number is at most {limit:g}")


# Radius and step of two grids. Sixteen robots of half a metre find places about one in the first,
# side by side, by steps of a fifth of a base. Around 62 of another client only the second has room.
_SEARCH_GRIDS_M = ((2.0, 0.1), (8.0, 0.4))
# Places that are tried in earnest, 0.3 ms each, of those that may have room.
_MAX_TRIES = 100
# How far below the requested height a floor is, and how far above, without being another place.
_FAR_BELOW_M, _NEAR_M = 2.1, 0.1
# Left on all sides of a robot that is moved: room to turn a little, and to drive off.
_CLEARANCE_M = 0.02


def _find_place(
    description: RobotDescription,
    requested: PlanarPose,
    z_m: float,
    ground: Places,
    robots: Collection[Robot],
    reason: NoStandError,
) -> RobotBody:
    """Base at the nearest place where it stands, of the requested heading.

    Raises:
        SpawnError: There is none.
    """
    cosine, sine = cos(requested.yaw_rad), sin(requested.yaw_rad)
    here = np.array([[requested.x_m, requested.y_m]])
    places = here + matmul(_search_offsets_m(), np.array([[cosine, sine], [-sine, cosine]]))
    may_stand = ground.may_stand(description, places, requested.yaw_rad, z_m, _CLEARANCE_M, robots)
    # No INIT takes the time of more than two ticks.
    for x, y in places[may_stand][:_MAX_TRIES].tolist():
        pose = replace(requested, x_m=x, y_m=y)
        with suppress(NoStandError):
            return ground.place(description, pose, z_m, clearance_m=_CLEARANCE_M, robots=robots)
    raise SpawnError(
        f"there is no free place within {_SEARCH_GRIDS_M[-1][0]:g} m of "
        f"{requested.x_m:g},{requested.y_m:g}, where {reason}"
    )


# At the first occupied place: 2 ms of a start, which few starts need.
@lru_cache(maxsize=1)
def _search_offsets_m() -> Floats:
    """(n, 2) offsets of the grids along the heading, the nearest of each first."""
    offsets: list[Floats] = []
    inner_m = 0.0
    for radius_m, step_m in _SEARCH_GRIDS_M:
        # Along the heading, so that bases of equal heading fit side by side.
        num_steps = round(radius_m / step_m)
        steps = range(-num_steps, num_steps + 1)
        # Squares of whole numbers: equal distances are equal, and ties have a fixed order.
        ranked = sorted((i * i + j * j, i, j) for i in steps for j in steps)
        first = np.square(inner_m / step_m)
        near = [(i, j) for square, i, j in ranked if first < square <= num_steps**2]
        offsets.append(step_m * np.array(near, dtype=float))
        inner_m = radius_m
    return np.concatenate(offsets)
