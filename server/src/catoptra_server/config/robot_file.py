"""What a robot file means: from the sections of a USARBot.ini to a RobotDescription.

The file's robot is its first `[USARBot.X]` section that has a SteeringType. Sensors are classes:
their own sections hold their defaults, as in USARBot.ini. The camera's part is in `omni_camera`.
"""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.omni_camera import read_omni_camera
from catoptra_server.config.settings import WORD_EXPECTED, Settings, is_word
from catoptra_server.robot.description import (
    DriveBase,
    GroundTruthDescription,
    OdometryDescription,
    RobotDescription,
    SensorDescription,
)


def read_robot(path: Path) -> tuple[RobotDescription, IniFile]:
    """Return the robot of a file, and the file for its unknown keys. Raises ConfigError."""
    file = IniFile(path)
    section = _robot_section(file)
    robot = RobotDescription(
        class_name=section.name,
        drive=_drive_base(section),
        sensors=_sensors(file, section),
        omni_camera=read_omni_camera(file, section),
        status_interval_s=section.number("msgTimer", 0.2, at_least=0.01, at_most=60.0),
        battery_s=section.number("batteryLife", 1200.0, at_least=0.0),
    )
    return robot, file


def _robot_section(file: IniFile) -> Settings:
    for name in file.names():
        section = file.section(name)
        if section.has("SteeringType"):
            if not is_word(name):
                raise ConfigError(section.where, key="section", value=name, expected=WORD_EXPECTED)
            return section
    raise file.section("USARBot.X").complain(
        "SteeringType", expected="a section [USARBot.X] with SteeringType=SkidSteered"
    )


def _drive_base(section: Settings) -> DriveBase:
    section.choice("SteeringType", ["SkidSteered"])
    return DriveBase(
        wheel_radius_m=section.number("WheelRadius", at_least=1e-3, at_most=10.0),
        wheel_separation_m=section.number("WheelSeparation", at_least=1e-3, at_most=10.0),
        wheel_base_m=section.number("WheelBase", at_least=1e-3, at_most=10.0),
        dimensions_m=section.vector("Dimensions", at_least=1e-3),
        ride_height_m=section.number("RideHeight", at_least=0.0, at_most=10.0),
        mass_kg=section.number("Mass", at_least=0.0),
        max_speed_rad_s=section.number("MaxSpeed", at_least=0.0, at_most=1000.0),
        max_torque=section.number("MaxTorque", 60.0, at_least=0.0),
        turn_slip=section.number("TurnSlip", 0.0, at_least=0.0, at_most=0.9),
        slip_noise=section.number("SlipNoise", 0.0, at_least=0.0, at_most=0.5),
    )


def _sensors(file: IniFile, section: Settings) -> tuple[SensorDescription, ...]:
    taken: set[str] = set()
    items = section.structs("Sensors")
    for item in items:
        name = item.word("ItemName").lower()
        if name in taken:
            raise item.complain("ItemName", expected="a name that no other sensor has")
        taken.add(name)
    return tuple(_sensor(file, item) for item in items)


def _sensor(file: IniFile, item: Settings) -> SensorDescription:
    item_class = item.text("ItemClass")
    defaults = file.section(item_class)
    name = item.text("ItemName")
    for key in ("Position", "Direction"):
        item.vector(key, (0.0, 0.0, 0.0))
    match item_class.rpartition(".")[2].lower():
        case "odometrysensor" | "odometry":
            return _odometry(name, defaults)
        case "groundtruthsensor" | "groundtruth":
            return GroundTruthDescription(
                name,
                defaults.number("ScanInterval", 0.2, at_least=0.01, at_most=60.0),
                defaults.integer("Decimals", 2, at_least=0, at_most=12),
            )
    raise item.complain("ItemClass", expected="USARBot.OdometrySensor or USARBot.GroundTruth")


def _odometry(name: str, defaults: Settings) -> OdometryDescription:
    return OdometryDescription(
        name=name,
        interval_s=defaults.number("ScanInterval", 0.2, at_least=0.01, at_most=60.0),
        distance_scale=defaults.number("DistanceScale", 1.0, at_least=0.0, at_most=10.0),
        turn_scale=defaults.number("TurnScale", 1.0, at_least=0.0, at_most=10.0),
        drift_rad_per_m=defaults.number("DriftPerMetre", 0.0, at_least=-10.0, at_most=10.0),
        distance_noise_m=defaults.number("DistanceNoise", 0.0, at_least=0.0, at_most=10.0),
        turn_noise_rad=defaults.number("TurnNoise", 0.0, at_least=0.0, at_most=10.0),
        heading_noise_rad=defaults.number("HeadingNoise", 0.0, at_least=0.0, at_most=10.0),
    )
