"""Sections of USARSim's own files load unchanged; keys without effect are reported once."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robot
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors.encoder import EncoderDescription
from catoptra_server.simulation.sensors.ins import InsDescription
from catoptra_server.simulation.sensors.range_scanner import RangeScannerDescription
from catoptra_server.simulation.sensors.sonar import SonarDescription

REAL = Path(__file__).parent / "real"


def read(name: str) -> tuple[RobotDescription, IniFile]:
    return read_robot(REAL / name)


def unknown_keys(file: IniFile) -> list[str]:
    return [entry.key for entry in file.unknown_names()]


def ignored_classes(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [r.message.partition(": ")[2] for r in caplog.records if r.levelname == "WARNING"]


def test_udk_when_loaded_reports_only_keys_without_effect(caplog: pytest.LogCaptureFixture) -> None:
    _, file = read("udk.ini")
    # Physics of the part, numbers that UDK's source does not configure, and the near plane.
    assert unknown_keys(file) == ["Weight", "Sigma", "Mean", "Mass", "CameraNearPlane"]
    assert ignored_classes(caplog) == [
        "class USARSensor.Battery is unknown: item battery has no effect"
    ]


def test_udk_when_loaded_has_all_parts_with_their_sections_numbers() -> None:
    robot, _ = read("udk.ini")
    parts = {sensor.name: sensor for sensor in robot.sensors}
    assert list(parts) == [
        *("GndTruth", "Odometer", "InsTest", "lms200", "TachTest", "W1", "EncTestW2"),
        *("Hokuyo", "Scanner", "LeftSonar", "Bumper"),
    ]
    ins, sonar, scanner = parts["InsTest"], parts["LeftSonar"], parts["Scanner"]
    assert isinstance(ins, InsDescription)
    assert (ins.precision, ins.noise, ins.has_timestamp) == (1000.0, 0.01, False)
    assert isinstance(sonar, SonarDescription)
    assert (sonar.num_cones, sonar.rays_per_cone, sonar.max_incidence_rad) == (10, 16, 0.1745329252)
    assert isinstance(scanner, RangeScannerDescription)
    assert (scanner.max_range_m, scanner.resolution_rad) == (4.0, 0.157)
    encoder = parts["EncTestW2"]
    assert isinstance(encoder, EncoderDescription)
    assert (encoder.shaft, encoder.noise_rad) == ("right", 0.005)
    assert [(camera.name, camera.fov_rad) for camera in robot.perspective_cameras] == [
        ("Camera", 1.3963)
    ]


def test_ut2004_when_loaded_reports_only_keys_without_effect(
    caplog: pytest.LogCaptureFixture,
) -> None:
    robot, file = read("ut2004.ini")
    # Karma's physics and its log; the motor's are of hinges, and there is none.
    assert unknown_keys(file) == [
        *("bDebug", "Weight", "Payload", "ChassisMass", "MotorTorque", "MotorSpeed")
    ]
    assert ignored_classes(caplog) == [
        "class USARBot.RangeScanner3D is unknown: item TarantulaRangeScanner3D has no effect"
    ]
    assert [sensor.name for sensor in robot.sensors] == ["Scanner1", "F1"]
    assert (robot.omni_camera, robot.chassis_joints) == (None, None)
    assert [package.name for package in robot.mission_packages] == ["CameraPanTilt"]
    assert robot.perspective_cameras[0].mount.parent == "CameraTilt"


@pytest.mark.parametrize("name", ["udk.ini", "ut2004.ini"])
def test_base_when_the_section_is_real_is_that_of_its_class(name: str) -> None:
    robot, _ = read(name)
    assert robot.drive.wheel_radius_m == {"P3AT": 0.098, "P2AT": 0.13}[robot.model_name]
