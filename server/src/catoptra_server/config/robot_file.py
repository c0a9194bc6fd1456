"""What a robot file means: from the sections of a USARBot.ini to RobotDescriptions.

A robot is a `[USARBot.X]` section that has a SteeringType, or whose class is one of USARSim's own:
the original files leave wheels and body to the class's source (`robot/known_bases`). Sensors are
classes: their own sections hold their defaults. What each list means is in `sensor_items`,
`cameras`, `packages`, `joint_parts` and `omni_camera`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TypedDict

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.cameras import is_camera, read_camera
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.joint_parts import read_joint_parts
from catoptra_server.config.omni_camera import read_omni_camera
from catoptra_server.config.packages import read_packages
from catoptra_server.config.sensor_items import is_sensor, read_sensor, report_unknown_class
from catoptra_server.config.settings import WORD_EXPECTED, Settings, Vector, is_word
from catoptra_server.robot.description import DriveBase, RobotDescription
from catoptra_server.robot.known_bases import KNOWN_BASES

# Lists of items that sense: UT2004's, and UDK's for everything.
_ITEM_LISTS = ("Sensors", "AddParts")


def read_robot(path: Path) -> tuple[RobotDescription, IniFile]:
    """Return the first robot of a file, and the file for its unknown keys. Raises ConfigError."""
    robots, file = read_robots(path)
    return robots[0], file


def read_robots(path: Path) -> tuple[tuple[RobotDescription, ...], IniFile]:
    """Return all robots of a file, and the file for its unknown keys. Raises ConfigError."""
    file = IniFile(path)
    robots = tuple(_robot(file, section) for section in _robot_sections(file))
    if not robots:
        raise file.section("USARBot.X").complain(
            "SteeringType", expected="a section [USARBot.X] with SteeringType=SkidSteered"
        )
    return robots, file


def _robot_sections(file: IniFile) -> Iterator[Settings]:
    """Yield the file's own robots first, then those of the files that it is based on."""
    sections = [file.section(name) for name in file.names()]
    for section in sorted(sections, key=lambda s: s.where.file != str(file.path)):
        name = section.name
        if section.has("SteeringType") or _known_base(section) is not None:
            if not is_word(name):
                raise ConfigError(section.where, key="section", value=name, expected=WORD_EXPECTED)
            yield section


def _known_base(section: Settings) -> DriveBase | None:
    package, _, model = section.name.rpartition(".")
    return KNOWN_BASES.get(model.lower()) if package.lower() == "usarbot" else None


def _robot(file: IniFile, section: Settings) -> RobotDescription:
    _refuse_same_names(section)
    items = [struct for key in _ITEM_LISTS for struct in section.structs(key)]
    omni = read_omni_camera(file, section)
    # What sits on the omni camera's viewpoint is a part of that camera.
    seen = [s for s in section.structs("Cameras") if not omni or _name(s) != omni.name.lower()]
    cameras = [struct for struct in (*seen, *items) if is_camera(struct)]
    for struct in (*seen, *items):
        if not is_sensor(struct) and not is_camera(struct):
            report_unknown_class(struct)
    return RobotDescription(
        class_name=section.name,
        drive=_drive_base(section),
        sensors=tuple(read_sensor(file, section, s) for s in items if is_sensor(s)),
        omni_camera=omni,
        status_interval_s=section.number("msgTimer", 0.2, at_least=0.01, at_most=60.0),
        battery_s=section.number("batteryLife", 1200.0, at_least=0.0),
        cameras=tuple(read_camera(file, section, struct) for struct in cameras),
        packages=read_packages(file, section),
        joint_parts=read_joint_parts(section),
    )


def _name(struct: Settings) -> str:
    return struct.text("ItemName").lower()


def _refuse_same_names(section: Settings) -> None:
    taken: set[str] = set()
    for key in (*_ITEM_LISTS, "Cameras"):
        for item in section.structs(key):
            name = item.word("ItemName").lower()
            if name in taken:
                raise item.complain("ItemName", expected="a name that no other sensor has")
            taken.add(name)


def _drive_base(section: Settings) -> DriveBase:
    """Return a base that a section with a SteeringType describes whole; else that of its class."""
    section.choice("SteeringType", ["SkidSteered"], "SkidSteered")
    known = None if section.has("SteeringType") else _known_base(section)

    def length(key: str, default: float | None, at_least: float = 1e-3) -> float:
        return section.number(key, default, at_least=at_least, at_most=10.0)

    return DriveBase(
        wheel_radius_m=length("WheelRadius", known.wheel_radius_m if known else None),
        wheel_separation_m=length("WheelSeparation", known.wheel_separation_m if known else None),
        wheel_base_m=length("WheelBase", known.wheel_base_m if known else None),
        **_dimensions(section, known),
        ride_height_m=length("RideHeight", known.ride_height_m if known else None, 0.0),
        mass_kg=section.number("Mass", known.mass_kg if known else None, at_least=0.0),
        max_speed_rad_s=section.number(
            "MaxSpeed", known.max_speed_rad_s if known else None, at_least=0.0, at_most=1000.0
        ),
        max_torque=section.number("MaxTorque", known.max_torque if known else 60.0, at_least=0.0),
        turn_slip=section.number("TurnSlip", 0.0, at_least=0.0, at_most=0.9),
        slip_noise=section.number("SlipNoise", 0.0, at_least=0.0, at_most=0.5),
    )


class _Dimensions(TypedDict):
    dimensions_m: Vector
    body_dimensions_m: Vector | None


def _dimensions(section: Settings, known: DriveBase | None) -> _Dimensions:
    """Return what GEO reports, and the body where that is none: then what is reported may be 0."""
    body = known.body_dimensions_m if known else None
    if section.has("BodyDimensions"):
        body = section.vector("BodyDimensions", at_least=1e-3, at_most=100.0)
    elif section.has("Dimensions"):
        body = None
    least_m = 1e-3 if body is None else 0.0
    told = section.vector("Dimensions", known.dimensions_m if known else None, at_least=least_m)
    return {"dimensions_m": told, "body_dimensions_m": body}
