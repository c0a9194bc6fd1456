"""Joints of the chassis: hinges of `JointParts=`, the list from which UT2004 builds robots.

`JointParts=(PartName="FRFlipper",JointClass=class'KDHinge',Parent="..",ParentPos=..,ParentAxis=..)`.
Hinges become joints that turn about ParentAxis with the robot's MotorSpeed and MotorTorque. Wheels
(KCarWheelJoint) and parts of other classes are left out: the keys of the drive base describe them.
Source: JointPart of KRobot.uc.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.optics.units import metres_from_uu
from catoptra_server.config.mounting import require_on_robot
from catoptra_server.config.section_reader import SectionReader, Vector
from catoptra_server.simulation.joint_chain import (
    CHASSIS_PARENT,
    LinkDescription,
    MissionPackageDescription,
)

log = logging.getLogger(__name__)

_HINGE_CLASSES = ("kdhinge", "khinge")
# Appearance, and how the engine fastens the part: without effect here, yet correct in a real file.
_IGNORED_KEYS = (
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


def read_joint_parts(robot: SectionReader) -> MissionPackageDescription | None:
    """Hinges of a robot's section as one chain of joints, in the list's order; None without any."""
    parts = robot.get_structs("JointParts")
    hinges = [part for part in parts if _is_hinge(part)]
    if not hinges:
        return None
    _require_unique_names(hinges)
    links = tuple(_read_link(robot, part, hinges[:number]) for number, part in enumerate(hinges))
    return MissionPackageDescription("JointParts", links)


def _is_hinge(part: SectionReader) -> bool:
    for key in _IGNORED_KEYS:
        part.get_str(key, "")
    class_ = part.get_str("JointClass").rpartition(".")[2].lower()
    if class_ not in _HINGE_CLASSES:
        log.info(
            "%s: part %s is no hinge and gets no joint", part.where, part.get_str("PartName", "")
        )
        part.ignore_all()
    return class_ in _HINGE_CLASSES


def _require_unique_names(parts: Sequence[SectionReader]) -> None:
    names: set[str] = set()
    for part in parts:
        name = part.get_wire_name("PartName").lower()
        if name in names:
            raise part.make_error("PartName", expected="a name that no other joint has")
        names.add(name)


def _read_link(
    robot: SectionReader, part: SectionReader, previous: Sequence[SectionReader]
) -> LinkDescription:
    """Joint of a part; the parent is a hinge further up in the list, or else the chassis.

    Args:
        robot: the robot's section, which has the motors' values.
        part: the struct of the hinge.
        previous: structs of the hinges before it.
    """
    name = part.get_str("Parent", "").lower()
    numbers = [n for n, one in enumerate(previous) if one.get_str("PartName").lower() == name]
    joint = Pose.from_rpy(_read_position(robot, part), _rpy_from_axis(part))
    # The file states positions and axes as if all parts were aligned with the chassis; a link is
    # relative to the joint frame of the parent, whose z is the parent's axis.
    if numbers:
        carrier = Pose.from_rpy((0.0, 0.0, 0.0), _rpy_from_axis(previous[numbers[0]]))
        joint = carrier.inverse() @ joint
    x, y, z = (float(value) for value in joint.translation)
    return LinkDescription(
        name=part.get_wire_name("PartName"),
        parent=numbers[0] + 1 if numbers else CHASSIS_PARENT,
        position_m=(x, y, z),
        rotation_rad=joint.to_rpy(),
        # 10 degrees a second, as in UT2004's USARBot.ini.
        max_speed_rad_s=robot.get_float("MotorSpeed", 0.1745, min_value=0.0, max_value=100.0),
        max_torque=robot.get_float("MotorTorque", 20.0, min_value=0.0),
        # A minimum above the maximum means no limits: KRobot.uc, as its CONF lines print it.
        min_rad=part.get_float("MinRange", 1.0),
        max_rad=part.get_float("MaxRange", 0.0),
    )


def _read_position(robot: SectionReader, part: SectionReader) -> Vector:
    x, y, z = part.get_vector("ParentPos", (0.0, 0.0, 0.0))
    if robot.get_bool("bMountByUU", False):
        x, y, z = metres_from_uu(x), metres_from_uu(y), metres_from_uu(z)
    require_on_robot(part, "ParentPos", (x, y, z))
    return x, y, z


def _rpy_from_axis(part: SectionReader) -> Vector:
    """Roll, pitch, yaw of a frame whose z is the hinge's axis; without ParentAxis, y."""
    x, y, z = part.get_vector("ParentAxis", (0.0, 1.0, 0.0))
    if not any((x, y, z)):
        raise part.make_error("ParentAxis", expected="a direction that is not zero")
    # The rotation about the axis itself is free: roll 0 leaves the angle 0 along the chassis.
    return 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)
