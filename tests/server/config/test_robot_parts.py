"""Parts of robot files: sensors with their real lines, hinges of JointParts, mission packages."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_file import read_robot
from catoptra_server.simulation.robot_description import (
    MissionPackageDescription,
    Mount,
    RobotDescription,
    SensorDescription,
)
from catoptra_server.simulation.sensors.encoder import EncoderDescription
from catoptra_server.simulation.sensors.ground_truth import GroundTruthDescription
from catoptra_server.simulation.sensors.ins import InsDescription
from catoptra_server.simulation.sensors.range_scanner import RangeScannerDescription
from catoptra_server.simulation.sensors.sonar import SonarDescription
from catoptra_server.simulation.sensors.tachometer import TachometerDescription
from helpers.configs import ROBOTS


def read(folder: Path, item: str, sections: str = "") -> SensorDescription:
    path = folder / "robot.ini"
    path.write_text(f"[USARBot.P2AT]\n{item}\n{sections}", encoding="utf-8")
    (sensor,) = read_robot(path)[0].sensors
    return sensor


ODOMETER = "AddParts=(ItemClass=class'USARSensor.Odometry',ItemName=\"O\")"
SCANNER = "Sensors=(ItemClass=class'USARBot.RangeScanner',ItemName=\"S\")"


@pytest.mark.parametrize(("line", "interval_s"), [("ScanInterval=.1", 0.1), ("", 0.2)])
def test_interval_when_configured_is_the_class_s_and_else_a_fifth_of_a_second(
    tmp_path: Path, line: str, interval_s: float
) -> None:
    sensor = read(tmp_path, ODOMETER, f"[USARSensor.Odometry]\n{line}\n")
    assert sensor.interval_s == interval_s


@pytest.mark.parametrize("line", ["MaxRange=-1", "Resolution=0.001"])
def test_number_when_no_scanner_can_have_it_is_rejected(tmp_path: Path, line: str) -> None:
    # The second makes lines that are too long for clients.
    with pytest.raises(ConfigError, match=line.partition("=")[0]):
        read(tmp_path, SCANNER, f"[USARBot.RangeScanner]\n{line}\n")


def test_sonar_when_of_the_real_file_is_read(tmp_path: Path) -> None:
    sonar = read(
        tmp_path,
        "Sensors=(ItemClass=class'USARBot.SonarSensor',ItemName=\"F1\",Position=(X=0.0,Y=0.0,Z=-0.0),"
        "Direction=(Y=0.0,Z=-1.5707964,X=0.0))",
        "[SonarSensor]\n[USARBot.SonarSensor]\nbeamAngle=0.349;\ntracesPerCone=16;\nMaxRange=5.0\n",
    )
    assert isinstance(sonar, SonarDescription)
    assert (sonar.name, sonar.beam_rad, sonar.rays_per_cone, sonar.max_range_m) == (
        "F1",
        0.349,
        16,
        5.0,
    )
    assert sonar.mount.rotation_rad == (0.0, 0.0, -1.5707964)


def test_scanner_when_of_the_real_udk_line_has_its_class_s_numbers(tmp_path: Path) -> None:
    line = (
        "AddParts=(ItemClass=class'USARSensor.SICK',ItemName=\"lms200\","
        "Position=(X=0.2085,Y=0.0,Z=-0.2),Direction=(x=0.0,y=0.0,z=0.0))"
    )
    scanner = read(tmp_path, line)
    assert isinstance(scanner, RangeScannerDescription)
    assert (scanner.fov_rad, scanner.resolution_rad) == (3.14159, 0.01745)
    assert (scanner.max_range_m, scanner.mount.position_m) == (20.0, (0.2085, 0.0, -0.2))


@pytest.mark.parametrize(
    ("name", "parent", "shaft"),
    [
        ("ECLeft", "", "left"),
        ("ECRight", "", "right"),
        ("ECPan", "", "CameraPan"),
        ("ECTilt", "", "CameraTilt"),
        ("EncTestW0", "", "right"),
        ("W3", "", "left"),
        ("E1", "LeftFWheel", "left"),
        ("Other", "", "other"),
    ],
)
def test_encoder_when_named_counts_its_shaft(
    tmp_path: Path, name: str, parent: str, shaft: str
) -> None:
    mounted = f',Parent="{parent}"' if parent else ""
    item = f"Sensors=(ItemClass=class'USARBot.EncoderSensor',ItemName=\"{name}\"{mounted})"
    encoder = read(tmp_path, item)
    assert isinstance(encoder, EncoderDescription)
    assert encoder.shaft == shaft


def test_ins_when_of_the_real_section_drifts(tmp_path: Path) -> None:
    section = "[USARSensor.INS]\nScanInterval=0.2\nDrifting=true\nPrecision=1000\nNoise=0.01\n"
    ins = read(tmp_path, "AddParts=(ItemClass=class'USARSensor.INS',ItemName=\"I\")", section)
    assert isinstance(ins, InsDescription)
    assert (ins.is_drifting, ins.noise) == (True, 0.01)


def test_p2at_when_read_has_the_sixteen_sonars_of_the_reference() -> None:
    sonars = [
        s for s in read_robot(ROBOTS / "p2at.ini")[0].sensors if isinstance(s, SonarDescription)
    ]
    assert [s.name for s in sonars] == [f"{side}{n}" for side in "FR" for n in range(1, 9)]
    assert sonars[1].mount.position_m == (0.185, -0.115, 0.0)
    assert sonars[1].mount.rotation_rad == (0.0, 0.0, -0.8727)


def test_tachometer_when_of_the_real_line_has_four_wheels(tmp_path: Path) -> None:
    item = "AddParts=(ItemClass=class'USARSensor.Tachometer',ItemName=\"TachTest\",Position=(X=0))"
    assert read(tmp_path, item) == TachometerDescription("TachTest", 0.2, Mount(), num_wheels=4)
    two = read(tmp_path, item, "[USARSensor.Tachometer]\nScanInterval=0.5\nWheels=2\n")
    assert two == TachometerDescription("TachTest", 0.5, Mount(), num_wheels=2)


def test_ins_when_of_the_real_section_has_its_precision(tmp_path: Path) -> None:
    section = "[USARSensor.INS]\nPrecision=1000\nbWithTimeStamp=false\n"
    ins = read(tmp_path, "AddParts=(ItemClass=class'USARSensor.INS',ItemName=\"I\")", section)
    assert isinstance(ins, InsDescription)
    assert (ins.precision, ins.has_timestamp) == (1000.0, False)


def test_scanner_when_of_the_real_section_has_its_axes(tmp_path: Path) -> None:
    item = "AddParts=(ItemClass=class'USARSensor.RangeScanner',ItemName=\"S\")"
    scanner = read(tmp_path, item, "[USARSensor.RangeScanner]\nbPitch=true\nbYaw=false\n")
    assert isinstance(scanner, RangeScannerDescription)
    assert (scanner.is_panning, scanner.is_tilting) == (False, True)


def test_sonar_when_of_the_real_section_has_its_cones_and_angles(tmp_path: Path) -> None:
    section = (
        "[USARSensor.SonarSensor]\nbeamAngle=0.349;\nmaxAngleOfIncidence=0.1745329252;\n"
        "numberOfCones=10\ntracesPerCone=16;\n"
    )
    item = "AddParts=(ItemClass=class'USARSensor.SonarSensor',ItemName=\"F1\")"
    sonar = read(tmp_path, item, section)
    assert isinstance(sonar, SonarDescription)
    assert (sonar.beam_rad, sonar.num_cones, sonar.rays_per_cone) == (0.349, 10, 16)
    assert sonar.max_incidence_rad == 0.1745329252


def test_ground_truth_when_not_fixed_to_the_platform_is_of_the_sensor(tmp_path: Path) -> None:
    item = "AddParts=(ItemClass=class'USARSensor.GroundTruth',ItemName=\"G\")"
    truth = read(tmp_path, item, "[USARSensor.GroundTruth]\nFixedToPlatform=false\n")
    assert truth == GroundTruthDescription("G", 0.2, 2, Mount(), is_chassis_pose=False)


@pytest.mark.parametrize("class_", ["Odometry", "Encoder", "Touch", "INS", "GPS"])
@pytest.mark.parametrize("has_timestamp", [True, False])
def test_time_stamp_when_configured_is_of_its_class(
    tmp_path: Path, class_: str, has_timestamp: bool
) -> None:
    item = f"AddParts=(ItemClass=class'USARSensor.{class_}',ItemName=\"S\")"
    sensor = read(tmp_path, item, f"[USARSensor.{class_}]\nbWithTimeStamp={has_timestamp}\n")
    assert sensor.has_timestamp is has_timestamp  # type: ignore[union-attr] # these classes have it


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


def read_joints(folder: Path, text: str) -> MissionPackageDescription:
    parts = read_robot_section(folder, text).chassis_joints
    assert parts is not None
    return parts


def test_joints_when_listed_are_the_hinges_with_the_robots_motor(tmp_path: Path) -> None:
    parts = read_joints(
        tmp_path, "MotorSpeed=0.5\nMotorTorque=7\n" + WHEEL + HINGE.format("FR", "")
    )
    (link,) = parts.links
    assert (link.name, link.parent, link.position_m) == ("FR", -1, (0.2, 0.1, 0.0))
    assert (link.max_speed_rad_s, link.max_torque) == (0.5, 7.0)
    assert link.limit_angle(99.0) == 99.0


def test_joint_when_turned_goes_about_its_axis(tmp_path: Path) -> None:
    parts = read_joints(tmp_path, HINGE.format("FR", ""))
    turned = parts.robot_from_link(1, {"fr": -0.5})
    # About -y by -0.5: forward goes up, which is -z.
    assert turned.rotation[:, 0] == pytest.approx(np.array([math.cos(0.5), 0.0, -math.sin(0.5)]))
    assert parts.robot_from_link(1, {}).rotation == pytest.approx(np.eye(3))


def test_joint_when_its_parent_is_a_joint_moves_with_it(tmp_path: Path) -> None:
    parts = read_joints(tmp_path, HINGE.format("Arm", "Chassis") + HINGE.format("Hand", "ARM"))
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
    assert read_joints(tmp_path, text).links[0].position_m == (1.0, 0.1, 0.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (HINGE.format("FR", "").replace("Y=-1", "Y=0"), "not zero"),
        (HINGE.format("FR", "") + HINGE.format("fr", ""), "no other joint"),
    ],
)
def test_joint_when_impossible_is_rejected(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        read_joints(tmp_path, text)


def test_kenaf_when_read_has_four_flippers_and_nothing_unknown() -> None:
    robot, file = read_robot(ROBOTS / "kenaf.ini")
    assert file.unknown_names() == []
    assert robot.chassis_joints is not None
    assert [link.name for link in robot.chassis_joints.links] == [
        "FRFlipper", "FLFlipper", "RRFlipper", "RLFlipper",
    ]  # fmt: skip


def test_joint_when_far_from_the_robot_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"ParentPos=.*within 100 m"):
        read_joints(tmp_path, HINGE.format("FR", "").replace("X=0.2", "X=200"))


HEAD = (
    'MisPkgs=(PkgName="CameraPanTilt",Location=(Y=0.0,X=0.1,Z=-0.3),'
    "PkgClass=class'USARMisPkg.{}')\n"
)


def read_packages(folder: Path, text: str) -> tuple[MissionPackageDescription, ...]:
    path = folder / "robot.ini"
    path.write_text("[USARBot.P2AT]\n" + text, encoding="utf-8")
    return read_robot(path)[0].mission_packages


def test_package_when_known_has_the_joints_of_ut2004_at_its_location(tmp_path: Path) -> None:
    (package,) = read_packages(tmp_path, HEAD.format("CameraPanTilt"))
    assert [link.name for link in package.links] == ["CameraPan", "CameraTilt"]
    assert package.links[0].position_m == (0.1, 0.0, -0.3)


def test_package_when_its_section_lists_links_has_those(tmp_path: Path) -> None:
    links = '[USARMisPkg.Arm]\nLinks=(Name="Elbow",Parent=-1,MaxSpeed=2,MinRange=-1,MaxRange=1)\n'
    (package,) = read_packages(tmp_path, HEAD.format("Arm") + links)
    (link,) = package.links
    assert (link.name, link.max_speed_rad_s, link.limit_angle(9.0)) == ("Elbow", 2.0, 1.0)


def test_package_when_without_joints_is_left_out(tmp_path: Path) -> None:
    assert read_packages(tmp_path, HEAD.format("OmniCamPillar")) == ()


@pytest.mark.parametrize("key", ["Location", "Position"])
def test_package_when_far_from_the_robot_is_rejected(tmp_path: Path, key: str) -> None:
    link = 'Links=(Name="Elbow",Parent=-1,Position=(X=0))'
    text = f"{HEAD.format('Arm')}[USARMisPkg.Arm]\n{link}\n"
    near = {"Location": "X=0.1,", "Position": "X=0)"}[key]
    text = text.replace(near, f"X=5000{near[-1]}")
    with pytest.raises(ConfigError, match=f"{key}=.*within 100 m"):
        read_packages(tmp_path, text)
