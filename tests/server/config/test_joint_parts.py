"""Joints of robot files: hinges of JointParts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_file import read_robot
from catoptra_server.simulation.joint_chain import MissionPackageDescription
from catoptra_server.simulation.robot_description import RobotDescription
from helpers.configs import ROBOTS

HINGE = (
    "JointParts=(PartName=\"{}\",PartClass=class'USARModels.Flipper',JointClass=class'KDHinge',"
    'BrakeTorque=20,Parent="{}",ParentPos=(X=0.2,Y=0.1,Z=0),ParentAxis=(X=0,Y=-1,Z=0))\n'
)
WHEEL = (
    "JointParts=(PartName=\"FRWheel\",PartClass=class'USARModels.Tire',"
    "JointClass=class'KCarWheelJoint',bSteeringLocked=true,ParentPos=(X=0.1,Y=0.2,Z=0))\n"
)


def read_robot_section(folder: Path, text: str) -> RobotDescription:
    path = folder / "robot.ini"
    path.write_text("[USARBot.P2AT]\n" + text, encoding="utf-8")
    robot, file = read_robot(path)
    assert file.unknown_names() == []
    return robot


def read(folder: Path, text: str) -> MissionPackageDescription:
    parts = read_robot_section(folder, text).chassis_joints
    assert parts is not None
    return parts


def test_joints_when_listed_are_the_hinges_with_the_robots_motor(tmp_path: Path) -> None:
    parts = read(tmp_path, "MotorSpeed=0.5\nMotorTorque=7\n" + WHEEL + HINGE.format("FR", ""))
    (link,) = parts.links
    assert (link.name, link.parent, link.position_m) == ("FR", -1, (0.2, 0.1, 0.0))
    assert (link.max_speed_rad_s, link.max_torque) == (0.5, 7.0)
    assert link.clamp(99.0) == 99.0


def test_joint_when_turned_goes_about_its_axis(tmp_path: Path) -> None:
    parts = read(tmp_path, HINGE.format("FR", ""))
    turned = parts.robot_from_link(1, {"fr": -0.5})
    # About -y by -0.5: forward goes up, which is -z.
    assert turned.rotation[:, 0] == pytest.approx(np.array([math.cos(0.5), 0.0, -math.sin(0.5)]))
    assert parts.robot_from_link(1, {}).rotation == pytest.approx(np.eye(3))


def test_joint_when_its_parent_is_a_joint_moves_with_it(tmp_path: Path) -> None:
    parts = read(tmp_path, HINGE.format("Arm", "Chassis") + HINGE.format("Hand", "ARM"))
    assert [link.parent for link in parts.links] == [-1, 1]
    assert parts.robot_from_link(2, {}).translation[0] == pytest.approx(0.4)


def test_camera_when_mounted_on_a_joint_is_carried_by_it(tmp_path: Path) -> None:
    robot = read_robot_section(tmp_path, HINGE.format("FR", ""))
    carried = robot.robot_from_part("fr", {"fr": 0.5})
    assert tuple(carried.translation) == pytest.approx((0.2, 0.1, 0.0))
    assert carried.rotation[0, 0] == pytest.approx(math.cos(0.5))


def test_joints_when_there_are_wheels_alone_are_none(tmp_path: Path) -> None:
    assert read_robot_section(tmp_path, WHEEL).chassis_joints is None


def test_places_when_in_unreal_units_become_metres(tmp_path: Path) -> None:
    text = "bMountByUU=true\n" + HINGE.format("FR", "").replace("X=0.2,Y=0.1", "X=250,Y=25")
    assert read(tmp_path, text).links[0].position_m == (1.0, 0.1, 0.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (HINGE.format("FR", "").replace("Y=-1", "Y=0"), "not zero"),
        (HINGE.format("FR", "") + HINGE.format("fr", ""), "no other joint"),
    ],
)
def test_joint_when_impossible_is_rejected(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        read(tmp_path, text)


def test_kenaf_when_read_has_four_flippers_and_nothing_unknown() -> None:
    robot, file = read_robot(ROBOTS / "kenaf.ini")
    assert file.unknown_names() == []
    assert robot.chassis_joints is not None
    assert [link.name for link in robot.chassis_joints.links] == [
        "FRFlipper", "FLFlipper", "RRFlipper", "RLFlipper",
    ]  # fmt: skip


def test_joint_when_far_from_the_robot_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"ParentPos=.*within 100 m"):
        read(tmp_path, HINGE.format("FR", "").replace("X=0.2", "X=200"))
