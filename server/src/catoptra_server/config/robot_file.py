"""Robot files: from the sections of a USARBot.ini to RobotDescriptions.

A robot is a `[USARBot.X]` section with a SteeringType, or one of a class of USARSim itself, whose
original files leave wheels and dimensions to the class's source
(`simulation/drive.py:STANDARD_BASES`). Sensors and cameras are classes with sections of their own;
`mirror_camera` and `robot_cameras` read the cameras.

The file describes the drive: slip and odometry errors are configuration, so that the two robots of
the paper's experiment are files based on a third (`[Configuration] BasedOn=`, as in UDK). A section
without a SteeringType has the base of its class.

Sensors are items of `Sensors=` (UT2004) and `AddParts=` (UDK). The classes, by the last part of a
class's name, are in `SENSOR_KINDS` of `simulation/sensors`, with a reader for each.
Parameters are in the section of the class; defaults are as in UDK's DefaultUSAR.ini.

Mission packages: `MisPkgs=(PkgName=..,Location=..,PkgClass=..)`. The class's section lists the
joints, an extension of USARSim's form: `Links=(Name="CameraPan",Parent=-1,Position=..,Direction=..,
MaxSpeed=..,MaxTorque=..,MinRange=..,MaxRange=..)`. USARSim has joints in the class's source, so
that STANDARD_PACKAGES describes the pan-tilt head of UT2004's robots.

Joints of the chassis are hinges of `JointParts=`, the list from which UT2004 builds robots:
`JointParts=(PartName="FRFlipper",JointClass=class'KDHinge',Parent="..",ParentPos=..,ParentAxis=..)`.
A hinge becomes a joint that turns about ParentAxis with the robot's MotorSpeed and MotorTorque.
Wheels (KCarWheelJoint) and parts of other classes are left out: the keys of the drive base are
enough. Source: JointPart of KRobot.uc.

[Catoptra.Tripod] is a camera without a robot: the same lists, no keys of a base.

Boxes=, Meshes= and the other lists of shapes of a world file are the body that cameras show, in the
chassis frame, in place of chassis and wheels; with colours, textures and the mesh files' own.
Collisions and sensors keep the base's dimensions.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypedDict, get_args

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.names import suggest_name
from catoptra_protocol.optics.elementary import arctan2, hypot
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.camera_sections import metres_from_uu, read_mount, require_on_robot
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mirror_camera import read_mirror_camera
from catoptra_server.config.robot_cameras import (
    is_lens_camera,
    is_perspective_camera,
    read_lens_camera,
    read_perspective_camera,
)
from catoptra_server.config.section_reader import SectionReader, Vector
from catoptra_server.config.world_file import read_items
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES
from catoptra_server.simulation.drive import STANDARD_BASES, TRIPOD
from catoptra_server.simulation.robot_description import (
    CHASSIS_PARENT,
    STANDARD_PACKAGES,
    BodyKind,
    DriveBase,
    LinkDescription,
    MissionPackageDescription,
    Mount,
    RobotDescription,
    SensorDescription,
)
from catoptra_server.simulation.sensors import SENSOR_KINDS
from catoptra_server.world.world_description import Item

log = logging.getLogger(__name__)


# Names of classes extend each other: RangeScanner3D (0.923) is no misspelt RangeScanner.
_MIN_SIMILARITY = 0.925
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


def is_sensor(item: SectionReader) -> bool:
    """Whether an item's class is a sensor of SENSOR_KINDS."""
    return item.get_class_name("ItemClass") in SENSOR_KINDS


def read_sensor(file: IniFile, robot: SectionReader, struct: SectionReader) -> SensorDescription:
    """Description of an item for which `is_sensor` holds."""
    item = _SensorItem(
        struct=struct,
        name=struct.get_wire_name("ItemName"),
        mount=read_mount(robot, struct),
        section=file.get_section(struct.get_str("ItemClass")),
    )
    name = struct.get_class_name("ItemClass")
    return SENSOR_KINDS[name].readers[name](item)


def report_unknown_class(item: SectionReader) -> None:
    """Log a warning for an item of an unknown class, but none for each key."""
    suggestion = suggest_name(item.get_class_name("ItemClass"), SENSOR_KINDS, _MIN_SIMILARITY)
    log.warning(
        "%s: class %s is unknown: item %s has no effect%s",
        item.where,
        item.get_str("ItemClass"),
        item.get_str("ItemName", "without a name"),
        f"; did you mean {suggestion}?" if suggestion else "",
    )
    item.ignore_all()


def read_mission_packages(
    file: IniFile, robot: SectionReader
) -> tuple[MissionPackageDescription, ...]:
    """Packages with joints of a robot's section, in order; packages without joints are logged."""
    packages = (_read_package(file, struct) for struct in robot.get_structs("MisPkgs"))
    return tuple(package for package in packages if package is not None)


def read_joint_parts(robot: SectionReader) -> MissionPackageDescription | None:
    """Hinges of a robot's section as one chain of joints, in the list's order; None without any."""
    parts = robot.get_structs("JointParts")
    hinges = [part for part in parts if _is_hinge(part)]
    if not hinges:
        return None
    _require_unique_joints(hinges)
    links = tuple(_read_link(robot, part, hinges[:number]) for number, part in enumerate(hinges))
    return MissionPackageDescription("JointParts", links)


@dataclass(frozen=True, slots=True)
class _SensorItem:
    """Input of a sensor's reader."""

    struct: SectionReader
    """The item itself, such as `(ItemClass=..,ItemName=..)`."""
    name: str
    """ItemName, which clients receive."""
    mount: Mount
    """Pose relative to the chassis or the item's Parent."""
    section: SectionReader
    """Section of the item's class; shared by all items of the class, empty if absent."""

    @property
    def interval_s(self) -> float:
        """Seconds from one reading to the next."""
        return self.section.get_float("ScanInterval", 0.2, min_value=0.01, max_value=60.0)

    def get_float(self, key: str, default: float, max_value: float = 1e4) -> float:
        """Non-negative number of the class's section: a range, a noise, a scale."""
        return self.section.get_float(key, default, min_value=0.0, max_value=max_value)

    def has_timestamp(self, default: bool) -> bool:
        """Whether readings in the UDK dialect carry a time (Odometry, Encoder, Touch, INS, GPS).

        Args:
            default: UDK's own choice for the class, where the section has no bWithTimeStamp.
        """
        return self.section.get_bool("bWithTimeStamp", default)


def _read_package(file: IniFile, struct: SectionReader) -> MissionPackageDescription | None:
    name, class_ = struct.get_wire_name("PkgName"), struct.get_str("PkgClass")
    section = file.get_section(class_)
    if section.has_key("Links"):
        links = tuple(_read_package_link(link) for link in section.get_structs("Links"))
    else:
        standard = STANDARD_PACKAGES.get(struct.get_class_name("PkgClass"))
        if standard is None:
            # No warning: the omnidirectional camera's pillar, for one, is a package without joints.
            log.info("%s: package %s of class %s has no joints", struct.where, name, class_)
            return None
        links = standard.links
    # Location mounts the package as a whole, by the joint of the first link.
    location = struct.get_vector("Location", links[0].position_m)
    require_on_robot(struct, "Location", location)
    return MissionPackageDescription(name, (replace(links[0], position_m=location), *links[1:]))


def _read_package_link(link: SectionReader) -> LinkDescription:
    position = link.get_vector("Position", (0.0, 0.0, 0.0))
    require_on_robot(link, "Position", position)
    return LinkDescription(
        name=link.get_wire_name("Name"),
        # -1 is the chassis; links are numbered from 1.
        parent=int(link.get_float("Parent", -1.0, min_value=-1.0, max_value=64.0)),
        position_m=position,
        rotation_rad=link.get_vector("Direction", (0.0, 0.0, 0.0)),
        max_speed_rad_s=link.get_float("MaxSpeed", 0.17, min_value=0.0, max_value=100.0),
        max_torque=link.get_float("MaxTorque", 20.0, min_value=0.0),
        # A minimum above the maximum means no limits, as in USARSim's CONF lines.
        min_rad=link.get_float("MinRange", 1.0),
        max_rad=link.get_float("MaxRange", 0.0),
    )


def _is_hinge(part: SectionReader) -> bool:
    for key in _IGNORED_KEYS:
        part.get_str(key, "")
    is_hinge = part.get_class_name("JointClass") in _HINGE_CLASSES
    if not is_hinge:
        log.info(
            "%s: part %s is no hinge and gets no joint", part.where, part.get_str("PartName", "")
        )
        part.ignore_all()
    return is_hinge


def _require_unique_joints(parts: Sequence[SectionReader]) -> None:
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
        previous: structs of the hinges before.
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
        # A minimum above the maximum means no limits: KRobot.uc, as in CONF lines.
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
    return 0.0, arctan2(hypot(x, y), z), arctan2(y, x)


# UT2004 has a list for sensors; UDK has one for items of all kinds.
_ITEM_LISTS = ("Sensors", "AddParts")
_TRIPOD = "catoptra.tripod"
# A section with one of these describes a robot.
_ROBOT_KEYS = (*_ITEM_LISTS, "Cameras", "CamTexActors", "MisPkgs", "JointParts", "batteryLife")
# UT2004's file has 24 robots; the camera of each class is prepared at start.
_MAX_ROBOT_CLASSES = 256
# The longest list of a real file has 26 items. Each is a sensor in every tick, and hinges are
# compared with each other.
_MAX_ITEMS = 256


def read_robot(
    path: Path, *, limit_bytes: int = DEFAULT_LIMIT_BYTES
) -> tuple[RobotDescription, IniFile]:
    """First robot of a file, and the file for a report of unknown keys. Raises ConfigError."""
    robots, file = read_robots(path, limit_bytes=limit_bytes)
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
    if section.name.lower() == _TRIPOD:
        return TRIPOD
    return STANDARD_BASES.get(model.lower()) if package.lower() == "usarbot" else None


def _read_robot_section(file: IniFile, section: SectionReader) -> RobotDescription:
    _require_few_items(section)
    _require_unique_sensors(section)
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
    joints = read_joint_parts(section)
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
        chassis_joints=joints,
        stand_in=section.get_str("StandIn", ""),
        is_smooth=section.get_bool("SmoothShading", False),
        body=_read_body(section, joints),
        items=tuple(_read_items(section, file.path.parent)),
    )


def _read_body(section: SectionReader, joints: MissionPackageDescription | None) -> BodyKind:
    """Body of a robot; without the key that of its class, or tracks with flippers, or wheels."""
    kind: BodyKind = "wheels"
    if joints and any(link.name.lower().endswith("flipper") for link in joints.links):
        kind = "tracks"
    elif _find_known_base(section) is STANDARD_BASES["p2dx"]:
        kind = "castor"
    kinds: tuple[BodyKind, ...] = get_args(BodyKind)
    chosen = section.get_choice("Body", ["auto", *kinds], "auto")
    return next((one for one in kinds if one == chosen), kind)


def _read_items(section: SectionReader, folder: Path) -> Iterator[Item]:
    for item in read_items(section, folder):
        look = item.material
        if look is not None and (any(look.emission) or look.gloss is not None):
            where, expected = (
                item.where or section.where,
                "no Emission and Gloss: what moves is matt",
            )
            raise ConfigError(where, key=item.name, value="Emission, Gloss", expected=expected)
        yield item


def _require_few_items(section: SectionReader) -> None:
    for key in (*_ITEM_LISTS, "Cameras", "MisPkgs", "JointParts"):
        items = section.get_structs(key)
        if len(items) > _MAX_ITEMS:
            raise items[_MAX_ITEMS].make_error(
                key, expected=f"at most {_MAX_ITEMS} items in a list"
            )


def _item_name(struct: SectionReader) -> str:
    return struct.get_str("ItemName").lower()


def _require_unique_sensors(section: SectionReader) -> None:
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
    if _find_known_base(section) is TRIPOD:
        return TRIPOD
    section.get_choice("SteeringType", ["SkidSteered"], "SkidSteered")
    # With a SteeringType the section describes the whole base, and a missing key is an error: the
    # values of USARSim's class of that name would silently describe another robot.
    known = None if section.has_key("SteeringType") else _find_known_base(section)

    def of_class(field: str) -> float | None:
        value: float | None = getattr(known, field, None)
        return value

    def read_length(key: str, field: str, min_m: float = 1e-3) -> float:
        return section.get_float(key, of_class(field), min_value=min_m, max_value=10.0)

    radius_m = read_length("WheelRadius", "wheel_radius_m")
    return DriveBase(
        wheel_radius_m=radius_m,
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
        **_read_ground_rules(section, radius_m),
    )


class _GroundRules(TypedDict):
    wheels_m: tuple[tuple[float, float], ...]
    step_limit_m: float | None
    max_climb_rad: float
    tilt_limit_rad: float | None


def _read_ground_rules(section: SectionReader, radius_m: float) -> _GroundRules:
    """Wheels, and what stops the base or lets it fall; angles in degrees."""

    def read_limit(key: str, max_value: float) -> float | None:
        if not section.has_key(key):
            return None
        return section.get_float(key, min_value=0.0, max_value=max_value)

    wheels = section.get_structs("Wheels", example="(X=0.15,Y=-0.2)")
    if wheels and len(wheels) < 3:
        raise section.make_error("Wheels", expected="three wheels or more, or none for four")
    climb, tilt = read_limit("MaxClimbAngle", 89.0), read_limit("MaxTilt", 89.0)
    return {
        "wheels_m": tuple(
            (
                one.get_float("X", min_value=-10.0, max_value=10.0),
                one.get_float("Y", min_value=-10.0, max_value=10.0),
            )
            for one in wheels
        ),
        "step_limit_m": read_limit("MaxStep", radius_m),
        "max_climb_rad": math.radians(35.0 if climb is None else climb),
        "tilt_limit_rad": None if tilt is None else math.radians(tilt),
    }


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
