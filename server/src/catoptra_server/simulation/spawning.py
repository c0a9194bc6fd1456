"""Class, start pose and name of a robot, from the parameters of INIT."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.usarsim.commands import Init
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.world_description import StartPlace


def find_class(classes: Sequence[RobotDescription], name: str) -> RobotDescription | None:
    """First class of a name in any case, with or without the package; None if there is none."""
    for known in classes:
        if name.lower() in (known.class_name.lower(), known.model_name.lower()):
            return known
    return None


def spawn_pose(init: Init, starts: Sequence[StartPlace]) -> PlanarPose | None:
    """Pose of a new robot on the floor; None for an unknown start.

    The location precedes the start. Height and tilt of either are ignored: a base that is not on
    the floor could not drive.
    """
    if init.location_m is not None:
        (x, y, _), (_, _, yaw) = init.location_m, init.rotation_rad
        return PlanarPose(x, y, wrap_angle(yaw))
    # The first start of the name wins, as for classes.
    for start in starts:
        if init.start is not None and start.name.lower() == init.start.lower():
            (x, y, _), (_, _, yaw) = start.location_m, start.rotation_rad
            return PlanarPose(x, y, wrap_angle(yaw))
    return None


def unique_name(requested: str, existing: Collection[str]) -> str:
    """Requested name, followed by the smallest number from 2 that makes the name unique."""
    if requested not in existing:
        return requested
    # Among n + 1 candidates at least one is not among n existing names.
    numbered = (f"{requested}{number}" for number in range(2, len(existing) + 3))
    return next(name for name in numbered if name not in existing)
