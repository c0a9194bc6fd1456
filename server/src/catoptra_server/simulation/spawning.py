"""Class, place and name of a new robot, from the parameters of INIT.

A robot is spawned where it touches nothing: a base in contact could hardly move, and robots inside
each other fill each other's images. A place that is not free is replaced by the nearest free one of
the same heading, within 2 m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Bools, Floats, wrap_angle
from catoptra_protocol.usarsim.commands import Init
from catoptra_protocol.usarsim.reports import StartPose
from catoptra_server.frames.image_port import CameraRobot
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.robot_shapes import (
    OmniCameraTower,
    RobotDimensions,
    build_ego_body_mesh,
    build_robot_mesh,
)

# Whether places, (n, 2) metres, are free for a base with some metres around it.
PlaceTest = Callable[[Floats, float], Bools]


class SpawnError(CatoptraError):
    """INIT spawns no robot; the message is the reason, in words for the client."""


def place_robot(
    init: Init,
    classes: Sequence[RobotDescription],
    starts: Sequence[StartPose],
    make_place_test: Callable[[RobotDescription, float], PlaceTest],
) -> tuple[RobotDescription, PlanarPose, PlanarPose]:
    """Class of a new robot, requested pose, and the nearest pose that is free.

    Args:
        init: The request.
        classes: Classes that it may name.
        starts: Start places that it may name.
        make_place_test: Test of places for a class at a heading in radians.

    Raises:
        SpawnError: No class, start or free place answers to INIT.
    """
    description = find_class(classes, init.class_name)
    requested = _spawn_pose(init, starts)
    are_free = make_place_test(description, requested.yaw_rad)
    return description, requested, _find_free_pose(requested, are_free)


def find_class(classes: Sequence[RobotDescription], name: str) -> RobotDescription:
    """First class of a name in any case, with or without the package.

    Raises:
        SpawnError: There is none.
    """
    for known in classes:
        if name.lower() in (known.class_name.lower(), known.model_name.lower()):
            return known
    names = ", ".join(known.class_name for known in classes)
    raise SpawnError(f"there is no class {name!r}: this server has {names}")


def unique_name(requested: str, existing: Collection[str]) -> str:
    """Requested name, followed by the smallest number from 2 that makes the name unique."""
    if requested not in existing:
        return requested
    # Among n + 1 candidates at least one is not among n existing names.
    numbered = (f"{requested}{number}" for number in range(2, len(existing) + 3))
    return next(name for name in numbered if name not in existing)


class RobotMeshes:
    """The meshes of a fleet's classes, built once."""

    def __init__(self, descriptions: Sequence[RobotDescription]) -> None:
        # Renderers recognize a mesh by identity: a mesh built anew would be uploaded anew.
        self._meshes = {
            d.class_name: build_robot_mesh(_dimensions(d), _tower(d)) for d in descriptions
        }
        self._ego_meshes = {d.class_name: build_ego_mesh(d) for d in descriptions}
        # Forgotten with its robot.
        self._objects: WeakKeyDictionary[CameraRobot, DynamicObject] = WeakKeyDictionary()

    def dynamic_objects(self, robots: Iterable[CameraRobot]) -> tuple[DynamicObject, ...]:
        """Robots as dynamic objects, at their present poses; the same in all views of a tick."""
        return tuple(map(self._find_object, robots))

    def _find_object(self, robot: CameraRobot) -> DynamicObject:
        found = self._objects.get(robot)
        if (
            found is None
            or found.world_from_object is not robot.world_from_robot
            or found.twist is not robot.twist
        ):
            found = self._objects[robot] = _place_mesh(self._meshes[robot.class_name], robot)
        return found

    def ego_body(self, robot: CameraRobot) -> DynamicObject | None:
        """Parts of a robot that its own mirror may show; None unless the effect is configured."""
        mesh = self._ego_meshes[robot.class_name]
        if mesh is None:
            return None
        return _place_mesh(mesh, robot)


def build_ego_mesh(description: RobotDescription) -> ObjectMesh | None:
    """Mesh of a class as its own mirror shows the body; None unless the effect is configured."""
    omni, tower = description.mirror_camera, _tower(description)
    if omni is None or tower is None:
        return None
    is_configured = any(setting.effect.name == "SelfView" for setting in omni.effects.settings)
    # Only where configured: a mesh that no effect shows is never built.
    return build_ego_body_mesh(_dimensions(description), tower) if is_configured else None


# As far as landmarks may lie. The scene is drawn in float32, which rounds coordinates of 1e5 m to
# 8 mm; a place beyond 1e18 m has no cell number in 64 bits.
_MAX_COORDINATE_M = 1e5
# Far above any number of turns that a client could mean, and still wrapped to 1e-10 rad.
_MAX_ANGLE_RAD = 1e6


def _spawn_pose(init: Init, starts: Sequence[StartPose]) -> PlanarPose:
    """Requested pose of a new robot on the floor.

    The location precedes the start. Height and tilt of either are ignored: a base that is not on
    the floor could not drive.

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
    return PlanarPose(location_m[0], location_m[1], wrap_angle(rotation_rad[2]))


def _find_start(name: str | None, starts: Sequence[StartPose]) -> StartPose:
    # The first start of the name wins, as for classes.
    for start in starts:
        if name is not None and start.name.lower() == name.lower():
            return start
    names = ", ".join(start.name for start in starts) or "none"
    what = "a robot needs a start" if name is None else f"there is no start {name!r}"
    raise SpawnError(f"{what}: this world has {names}; or give a Location")


def _check_limits(key: str, values: tuple[float, float, float], limit: float) -> None:
    # A comparison with NaN is false: it is out of limits, too.
    if not all(abs(value) <= limit for value in values):
        text = ",".join(f"{value:g}" for value in values)
        raise SpawnError(f"{key} {text} is out of limits: each number is at most {limit:g}")


# Radius and step of two grids. Sixteen robots of half a metre find places about one in the first,
# side by side, by steps of a fifth of a base. Around 62 of another client only the second has room.
_SEARCH_GRIDS_M = ((2.0, 0.1), (8.0, 0.4))
# The nearest 314 reach 1 m far, where most searches end; all take 2 to 6 ms in crowded places.
_PLACES_PER_TEST = 314
# Left on all sides of a robot that is moved: room to turn a little, and to drive off.
_CLEARANCE_M = 0.02


def _find_free_pose(requested: PlanarPose, are_free: PlaceTest) -> PlanarPose:
    """Requested pose if free, else the nearest free one of the same heading, within 8 m.

    Args:
        requested: Pose to begin with.
        are_free: Test of places for the base at the requested heading.

    Raises:
        SpawnError: There is no free place.
    """
    here = np.array([[requested.x_m, requested.y_m]])
    if are_free(here, 0.0)[0]:
        return requested
    cos, sin = math.cos(requested.yaw_rad), math.sin(requested.yaw_rad)
    places = here + _search_offsets_m() @ np.array([[cos, sin], [-sin, cos]])
    for first in range(0, len(places), _PLACES_PER_TEST):
        group = places[first : first + _PLACES_PER_TEST]
        free = are_free(group, _CLEARANCE_M)
        if free.any():
            x, y = group[free.argmax()].tolist()
            return replace(requested, x_m=x, y_m=y)
    raise SpawnError(
        f"there is no free place within {_SEARCH_GRIDS_M[-1][0]:g} m of "
        f"{requested.x_m:g},{requested.y_m:g}"
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
        first = (inner_m / step_m) ** 2
        near = [(i, j) for square, i, j in ranked if first < square <= num_steps**2]
        offsets.append(step_m * np.array(near, dtype=float))
        inner_m = radius_m
    return np.concatenate(offsets)


def _place_mesh(mesh: ObjectMesh, robot: CameraRobot) -> DynamicObject:
    return DynamicObject(mesh, robot.world_from_robot, robot.twist, robot.name, robot.number)


def _dimensions(description: RobotDescription) -> RobotDimensions:
    drive = description.drive
    return RobotDimensions(
        drive.dimensions_m, drive.ride_height_m, drive.wheel_radius_m, drive.wheel_base_m
    )


def _tower(description: RobotDescription) -> OmniCameraTower | None:
    omni = description.mirror_camera
    return OmniCameraTower(omni.camera, omni.robot_from_mirror) if omni else None
