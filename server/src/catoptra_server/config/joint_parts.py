"""The joints of a robot itself: hinges of `JointParts=`, the list that UT2004 builds robots from.

`JointParts=(PartName="FRFlipper",JointClass=class'KDHinge',Parent="..",ParentPos=..,ParentAxis=..)`.
Hinges become joints that turn about ParentAxis, as fast and as strong as the robot's MotorSpeed and
MotorTorque. Wheels (KCarWheelJoint) and whatever else is listed are the base's, which other keys
describe. Source: JointPart of KRobot.uc.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.units import metres_from_uu
from catoptra_server.config.settings import Settings, Vector
from catoptra_server.robot.mission_package import (
    ON_CHASSIS,
    LinkDescription,
    MissionPackageDescription,
)

log = logging.getLogger(__name__)

_HINGES = ("kdhinge", "khinge")
# What a part looks like and how the engine fastens it: without meaning here, but no mistake.
_OF_THE_ENGINE = (
    "PartClass",
    "DrawScale3D",
    "bSteeringLocked",
    "bSuspensionLocked",
    "BrakeTorque",
    "ParentAxis2",
    "SelfPos",
    "SelfAxis",
    "SelfAxis2",
)


def read_joint_parts(robot: Settings) -> MissionPackageDescription | None:
    """Return the hinges of a robot's section, in order; None without any."""
    parts = robot.structs("JointParts")
    hinges = [part for part in parts if _is_hinge(part)]
    if not hinges:
        return None
    _refuse_same(hinges)
    links = tuple(_link(robot, part, hinges[:number]) for number, part in enumerate(hinges))
    return MissionPackageDescription("JointParts", links)


def _is_hinge(part: Settings) -> bool:
    for key in _OF_THE_ENGINE:
        part.text(key, "")
    class_ = part.text("JointClass").rpartition(".")[2].lower()
    if class_ not in _HINGES:
        log.info("%s: %s is no hinge: it has no joint here", part.where, part.text("PartName", ""))
        part.pass_over()
    return class_ in _HINGES


def _refuse_same(parts: Sequence[Settings]) -> None:
    taken: set[str] = set()
    for part in parts:
        name = part.word("PartName").lower()
        if name in taken:
            raise part.complain("PartName", expected="a name that no other joint has")
        taken.add(name)


def _link(robot: Settings, part: Settings, before: Sequence[Settings]) -> LinkDescription:
    """Return the joint of a part; its parent is a hinge further up in the list, or the chassis.

    The file's places and axes are those of parts aligned with the chassis, a link's those of its
    parent's joint.
    """
    name = part.text("Parent", "").lower()
    numbers = [n for n, one in enumerate(before) if one.text("PartName").lower() == name]
    joint = Pose.from_rpy(_place(robot, part), _turned_to(part))
    if numbers:
        carrier = Pose.from_rpy((0.0, 0.0, 0.0), _turned_to(before[numbers[0]]))
        joint = carrier.inverse() @ joint
    x, y, z = (float(value) for value in joint.translation)
    return LinkDescription(
        name=part.word("PartName"),
        parent=numbers[0] + 1 if numbers else ON_CHASSIS,
        position_m=(x, y, z),
        rotation_rad=joint.rpy(),
        max_speed_rad_s=robot.number("MotorSpeed", 0.1745, at_least=0.0, at_most=100.0),
        max_torque=robot.number("MotorTorque", 20.0, at_least=0.0),
        min_rad=part.number("MinRange", 1.0),
        max_rad=part.number("MaxRange", 0.0),
    )


def _place(robot: Settings, part: Settings) -> Vector:
    x, y, z = part.vector("ParentPos", (0.0, 0.0, 0.0))
    if robot.boolean("bMountByUU", False):
        return metres_from_uu(x), metres_from_uu(y), metres_from_uu(z)
    return x, y, z


def _turned_to(part: Settings) -> Vector:
    """Return roll, pitch, yaw of a frame whose z is the hinge's axis; a flipper's is y."""
    x, y, z = part.vector("ParentAxis", (0.0, 1.0, 0.0))
    if not any((x, y, z)):
        raise part.complain("ParentAxis", expected="a direction that is not zero")
    return 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)
