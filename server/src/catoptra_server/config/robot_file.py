"""Robot files: from the sections of a USARBot.ini to RobotDescriptions.

A robot is a `[USARBot.X]` section with a SteeringType, or one of a class of USARSim itself, whose
original files leave wheels and dimensions to the class's source
(`simulation/drive.py:STANDARD_BASES`). Sensors and cameras are classes with sections of their own;
`mirror_camera`, `robot_cameras` and `robot_parts` read the lists of the robot's section.

The file describes the drive: slip and odometry errors are configuration, so that the two robots of
the paper's experiment are files based on a third (`[Configuration] BasedOn=`, as in UDK). A section
without a SteeringType has the base of its class.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TypedDict

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mirror_camera import read_mirror_camera
from catoptra_server.config.robot_cameras import (
    is_lens_camera,
    is_perspective_camera,
    read_lens_camera,
    read_perspective_camera,
)
from catoptra_server.config.robot_parts import (
    is_sensor,
    read_joint_parts,
    read_mission_packages,
    read_sensor,
    report_unknown_class,
)
from catoptra_server.config.section_reader import SectionReader, Vector
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES
from catoptra_server.simulation.drive import STANDARD_BASES
from catoptra_server.simulation.robot_description import DriveBase, RobotDescription

# UT2004 has a list for sensors; UDK has one for items of all kinds.
_ITEM_LISTS = ("Sensors", "AddParts")
# A section with one of these describes a robot.
_ROBOT_KEYS = (*_ITEM_LISTS, "Cameras", "CamTexActors", "MisPkgs", "JointParts", "batteryLife")
# UT2004's file has 24 robots; the camera of each class is prepared at start.
_MAX_ROBOT_CLASSES = 256
# The longest list of a real file has 26 items. Each is a sensor in every tick, and hinges are
# compared with each other.
_MAX_ITEMS = 256


def read_robot(path: Path) -> tuple[RobotDescription, IniFile]:
    """First robot of a file, and the file for a report of unknown keys. Raises ConfigError."""
    robots, file = read_robots(path)
    return robots[0], file


def read_robots(
    path: Path, *, limit_bytes: int = DEFAULT_LIMIT_BYTES
) -> tuple[tuple[RobotDescription, ...], IniFile]:
    """All robots of a file, in the file's order, then the robots of base files.

    Args:
        path: the file.
        limit_bytes: memory that the view of each camera may take.

    Returns:
        The descriptions, at least one, and the file, whose unknown keys can be reported now.

    Raises:
        ConfigError: with file, line, key, value and the expected form.
    """
    file = IniFile(path, view_limit_bytes=limit_bytes)
    sections = tuple(_find_robot_sections(file))
    if len(sections) > _MAX_ROBOT_CLASSES:
        raise sections[_MAX_ROBOT_CLASSES].make_error(
            "SteeringType", expected=f"at most {_MAX_ROBOT_CLASSES} robots in a file"
        )
    robots = tuple(_read_robot_section(file, section) for section in sections)
    if not robots:
        is_world = file.has_section("Catoptra.World")
        raise ConfigError(
            SourceLocation(str(path)),
            key="section",
            value="",
            expected="a section such as [USARBot.MyRobot] with SteeringType=SkidSteered"
            + ("; this is a world's file" if is_world else ""),
        )
    return robots, file


def _find_robot_sections(file: IniFile) -> Iterator[SectionReader]:
    """Yield the sections of the file's own robots, then robots of its bases."""
    for section in sorted(file.sections(), key=lambda s: s.where.file != str(file.path)):
        if section.has_key("SteeringType") or _find_known_base(section) is not None:
            # Clients name the class in INIT and receive the name in frame headers: one line must
            # hold it.
            section.require_wire_name()
            yield section


def find_unserved_robots(file: IniFile) -> list[str]:
    """Sections that describe robots, but none that this server can drive."""
    return [
        section.name
        for section in file.sections()
        if any(map(section.has_key, _ROBOT_KEYS))
        and not section.has_key("SteeringType")
        and _find_known_base(section) is None
    ]


def _find_known_base(section: SectionReader) -> DriveBase | None:
    package, _, model = section.name.rpartition(".")
    return STANDARD_BASES.get(model.lower()) if package.lower() == "usarbot" else None


def _read_robot_section(file: IniFile, section: SectionReader) -> RobotDescription:
    _require_few_items(section)
    _require_unique_names(section)
    items = [struct for key in _ITEM_LISTS for struct in section.get_structs(key)]
    omni = read_mirror_camera(file, section)
    # The capture camera is in the list too, but as a part of the omnidirectional camera.
    camera_items = [
        s for s in section.get_structs("Cameras") if not omni or _item_name(s) != omni.name.lower()
    ]
    all_items = (*camera_items, *items)
    lenses = [struct for struct in all_items if is_lens_camera(file, struct)]
    others = [struct for struct in all_items if struct not in lenses]
    cameras = [struct for struct in others if is_perspective_camera(struct)]
    for struct in others:
        if not is_sensor(struct) and not is_perspective_camera(struct):
            report_unknown_class(struct)
    return RobotDescription(
        class_name=section.name,
        drive=_read_drive_base(section),
        sensors=tuple(read_sensor(file, section, s) for s in items if is_sensor(s)),
        omni_cameras=(
            *([omni] if omni else []),
            *(read_lens_camera(file, section, s) for s in lenses),
        ),
        status_interval_s=section.get_float("msgTimer", 0.2, min_value=0.01, max_value=60.0),
        battery_s=section.get_float("batteryLife", 1200.0, min_value=0.0),
        perspective_cameras=tuple(
            read_perspective_camera(file, section, struct) for struct in cameras
        ),
        mission_packages=read_mission_packages(file, section),
        chassis_joints=read_joint_parts(section),
        stand_in=section.get_str("StandIn", ""),
    )


def _require_few_items(section: SectionReader) -> None:
    for key in (*_ITEM_LISTS, "Cameras", "MisPkgs", "JointParts"):
        items = section.get_structs(key)
        if len(items) > _MAX_ITEMS:
            raise items[_MAX_ITEMS].make_error(
                key, expected=f"at most {_MAX_ITEMS} items in a list"
            )


def _item_name(struct: SectionReader) -> str:
    return struct.get_str("ItemName").lower()


def _require_unique_names(section: SectionReader) -> None:
    # Clients address sensors and cameras by name alone, across the lists and regardless of case.
    places: dict[str, SourceLocation] = {}
    for key in (*_ITEM_LISTS, "Cameras"):
        for item in section.get_structs(key):
            name = item.get_wire_name("ItemName").lower()
            if name in places:
                raise item.make_error(
                    "ItemName", expected=f"a name that no other sensor has; {places[name]} has it"
                )
            places[name] = item.where


def _read_drive_base(section: SectionReader) -> DriveBase:
    """Drive base of a robot; keys of the section override USARSim's values for the class."""
    section.get_choice("SteeringType", ["SkidSteered"], "SkidSteered")
    # With a SteeringType the section describes the whole base, and a missing key is an error: the
    # values of USARSim's class of that name would silently describe another robot.
    known = None if section.has_key("SteeringType") else _find_known_base(section)

    def of_class(field: str) -> float | None:
        value: float | None = getattr(known, field, None)
        return value

    def read_length(key: str, field: str, min_m: float = 1e-3) -> float:
        return section.get_float(key, of_class(field), min_value=min_m, max_value=10.0)

    return DriveBase(
        wheel_radius_m=read_length("WheelRadius", "wheel_radius_m"),
        wheel_separation_m=read_length("WheelSeparation", "wheel_separation_m"),
        wheel_base_m=read_length("WheelBase", "wheel_base_m"),
        **_read_dimensions(section, known),
        ride_height_m=read_length("RideHeight", "ride_height_m", 0.0),
        mass_kg=section.get_float("Mass", of_class("mass_kg"), min_value=0.0),
        max_speed_rad_s=section.get_float(
            "MaxSpeed", of_class("max_speed_rad_s"), min_value=0.0, max_value=1000.0
        ),
        max_torque=section.get_float("MaxTorque", of_class("max_torque") or 60.0, min_value=0.0),
        # At 1 no turn would be left: a robot that cannot turn is taken for a typing error.
        turn_slip=section.get_float("TurnSlip", 0.0, min_value=0.0, max_value=0.9),
        slip_noise=section.get_float("SlipNoise", 0.0, min_value=0.0, max_value=0.5),
    )


class _Dimensions(TypedDict):
    dimensions_m: Vector
    collision_dimensions_m: Vector | None


def _read_dimensions(section: SectionReader, known: DriveBase | None) -> _Dimensions:
    """Dimensions that GEO reports, and those for collisions where the two differ.

    Some classes of USARSim report (0,0,0): then BodyDimensions, or the class's, serve collisions.
    """
    body = known.collision_dimensions_m if known else None
    if section.has_key("BodyDimensions"):
        body = section.get_vector("BodyDimensions", min_value=1e-3, max_value=100.0)
    elif section.has_key("Dimensions"):
        body = None
    min_m = 1e-3 if body is None else 0.0
    reported = section.get_vector(
        "Dimensions", known.dimensions_m if known else None, min_value=min_m, max_value=100.0
    )
    return {"dimensions_m": reported, "collision_dimensions_m": body}
