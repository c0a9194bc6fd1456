"""What INIT asks for: a class, a place, a name."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.usarsim.commands import Init
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.world_description import StartPlace


def find_class(classes: Sequence[RobotDescription], name: str) -> RobotDescription | None:
    """Return the class of a name in any case; the package may be left out. The first one wins."""
    for known in classes:
        if name.lower() in (known.class_name.lower(), known.model_name.lower()):
            return known
    return None


def spawn_pose(init: Init, starts: Sequence[StartPlace]) -> PlanarPose | None:
    """Return where to put a robot: on the floor, upright, whatever height and tilt."""
    if init.location_m is not None:
        (x, y, _), (_, _, yaw) = init.location_m, init.rotation_rad
        return PlanarPose(x, y, wrap_angle(yaw))
    for start in starts:
        if init.start is not None and start.name.lower() == init.start.lower():
            (x, y, _), (_, _, yaw) = start.location_m, start.rotation_rad
            return PlanarPose(x, y, wrap_angle(yaw))
    return None


def unique_name(requested: str, existing: Collection[str]) -> str:
    """Return the wished name, with a number behind it if it is taken."""
    numbered = (f"{requested}{number}" for number in range(2, len(existing) + 3))
    return (
        requested if requested not in existing else next(n for n in numbered if n not in existing)
    )
