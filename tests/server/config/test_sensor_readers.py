"""Sensors of robot files: the real lines, and each kind's defaults and keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_file import read_robot
from catoptra_server.simulation.robot_description import (
    Mount,
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


def test_scanner_when_its_line_would_be_too_long_for_clients_is_rejected(tmp_path: Path) -> None:
    item = "Sensors=(ItemClass=class'USARBot.RangeScanner',ItemName=\"S\")"
    with pytest.raises(ConfigError, match="Resolution"):
        read(tmp_path, item, "[USARBot.RangeScanner]\nResolution=0.001\n")


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
