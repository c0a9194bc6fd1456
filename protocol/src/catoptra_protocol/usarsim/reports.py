"""The reports of a control server: NFO and STA, the table of all, and their lines.

NFO is the first line on a connection and the reply to GETSTARTPOSES, STA the periodic status of the
robot itself, every 0.2 s. Field order and the number of decimals are those of real captures:
clients index blocks by position.

To add a report: its class beside similar ones (WORD, fields, `from_message`, `to_messages`: the
lines in a dialect), its entries in the `Report` union and, if clients read the report, in
REPORT_PARSERS, a vector in tests/conformance/data/reports, its row in SPEC.md; for a sensor see
`readings`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_SERVER_LINE_BYTES
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.command_results import (
    CameraFov,
    CameraResult,
    CommandResult,
    InitResult,
    Viewport,
    ViewportsResult,
    result_from_message,
)
from catoptra_protocol.usarsim.configurations import (
    CameraConfiguration,
    Configuration,
    EncoderConfiguration,
    Geometry,
    GeometryItem,
    OdometryConfiguration,
    RangeScannerConfiguration,
    ScanIntervalConfiguration,
    SonarConfiguration,
    TextureRegion,
    TouchConfiguration,
    VehicleConfiguration,
    VehicleGeometry,
    geometry_from_message,
)
from catoptra_protocol.usarsim.grammar import (
    UDK_BLOCKS_WITHOUT_SPACE,
    Dialect,
    Message,
    Pairs,
    format_line,
    split_words,
)
from catoptra_protocol.usarsim.mission_package import (
    LinkConfiguration,
    LinkGeometry,
    LinkStatus,
    MissionPackageConfiguration,
    MissionPackageGeometry,
    MissionPackageStatus,
)
from catoptra_protocol.usarsim.readings import (
    EncoderReadings,
    GpsReading,
    GroundTruthReading,
    InsReading,
    OdometryReading,
    RangeScanReading,
    Reading,
    RfidReading,
    SonarReadings,
    TachometerReading,
    TouchReadings,
    VictimPart,
    VictimReading,
    reading_from_message,
)
from catoptra_protocol.usarsim.value_format import (
    format_boolean,
    format_fixed_point,
    format_vector,
    is_number,
)
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class Greeting:
    """The first line on every connection."""

    WORD: ClassVar[str] = "NFO"

    game_type: str
    level: str
    """Name of the world."""
    time_limit: int = 0
    """Minutes; 0 = none."""

    @classmethod
    def from_message(cls, message: Message) -> Greeting:
        """Parse the message of a line."""
        return cls(
            game_type=strict_fields.read_text(message, "Gametype"),
            level=strict_fields.read_text(message, "Level"),
            time_limit=strict_fields.read_integer(message, "TimeLimit", default=0),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        limit = str(self.time_limit)
        pairs = (("Gametype", self.game_type), ("Level", self.level), ("TimeLimit", limit))
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class StartPose:
    """A named pose of the world file, in the world frame."""

    name: str
    """One word."""
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""


@dataclass(frozen=True, slots=True)
class StartPoses:
    """The reply to GETSTARTPOSES: one block of `name x,y,z r,p,y`, absent without poses."""

    WORD: ClassVar[str] = "NFO"

    poses: tuple[StartPose, ...]

    @classmethod
    def from_message(cls, message: Message) -> StartPoses:
        """Parse a line, whose second block begins with the first name.

        Raises:
            RemoteProtocolError: The number of words does not fit the number of poses.
        """
        blocks = [pair for pair in message.pairs if pair[0].lower() != "startposes"]
        # No spaces inside a list of numbers, so the words come in threes: name, location, rotation.
        words = split_words(" ".join(" ".join(pair) for pair in blocks[:1]))
        if len(words) != 3 * strict_fields.read_integer(message, "StartPoses"):
            raise RemoteProtocolError(
                f"NFO {{StartPoses {strict_fields.read_text(message, 'StartPoses')}}}: "
                f"expected three words (name x,y,z r,p,y) per pose, not {len(words)} in total"
            )
        triples = zip(words[::3], words[1::3], words[2::3], strict=True)
        return cls(tuple(_parse_start_pose(message, *triple) for triple in triples))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line, the same in both dialects.

        Raises:
            LocalProtocolError: A name is not one word.
        """
        words = [word for pose in self.poses for word in _format_start_pose(pose)]
        # The block has no name of its own: the name of the first pose stands in its position.
        block = ((words[0], " ".join(words[1:])),) if words else ()
        return (Message(self.WORD, (("StartPoses", str(len(self.poses))), *block)),)


def _greeting_from_message(message: Message) -> Greeting | StartPoses:
    """Parse an NFO line of either kind."""
    is_poses = message.get("StartPoses") is not None
    return StartPoses.from_message(message) if is_poses else Greeting.from_message(message)


def _format_start_pose(pose: StartPose) -> tuple[str, str, str]:
    if not pose.name or " " in pose.name:
        raise LocalProtocolError(f"NFO: start pose {pose.name!r}: the name must be one word")
    return pose.name, format_vector(pose.location_m), format_vector(pose.rotation_rad)


def _parse_start_pose(message: Message, name: str, location: str, rotation: str) -> StartPose:
    return StartPose(
        name, *strict_fields.parse_vectors(message, Location=location, Orientation=rotation)
    )


# All other numeric blocks are joints: their names are those of the robot file.
_STANDARD_BLOCKS = frozenset(
    ("time", "type", "battery", "view", "frontsteer", "rearsteer", "lighttoggle", "lightintensity")
)


@dataclass(frozen=True, slots=True)
class VehicleStatus:
    """Status of a skid-steered robot."""

    WORD: ClassVar[str] = "STA"

    time_s: float
    battery_s: int
    """Whole seconds left."""
    vehicle_type: str = "GroundVehicle"
    light: bool = False
    view: int = -1
    """Tile of the robot's first camera; -1 = none."""
    joints: tuple[tuple[str, float], ...] = ()
    """Name and angle in radians of joints of the robot itself, such as flippers."""

    @classmethod
    def from_message(cls, message: Message) -> VehicleStatus:
        """Parse a line; UDK has no View. Further numeric blocks are joints."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            battery_s=strict_fields.read_integer(message, "Battery"),
            vehicle_type=strict_fields.read_text(message, "Type"),
            light=strict_fields.read_boolean(message, "LightToggle"),
            view=strict_fields.read_integer(message, "View", default=-1),
            joints=tuple(_parse_joints(message)),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        pairs = self._udk_pairs() if dialect is Dialect.UDK else self._ut2004_pairs()
        return (Message(self.WORD, pairs),)

    def _ut2004_pairs(self) -> Pairs:
        """Blocks of UT2004, each of which some client requires."""
        return (
            ("Type", self.vehicle_type),
            ("Time", format_fixed_point(self.time_s, 2)),
            # Always 0 on a skid-steered robot, but the Java client requires the blocks.
            ("FrontSteer", format_fixed_point(0.0)),
            ("RearSteer", format_fixed_point(0.0)),
            *self._joint_pairs(),
            ("LightToggle", format_boolean(self.light)),
            ("LightIntensity", "100" if self.light else "0"),
            # Integers, which the Java client parses as such.
            ("Battery", str(int(self.battery_s))),
            ("View", str(self.view)),
        )

    def _udk_pairs(self) -> Pairs:
        """Blocks of UDK."""
        return (
            ("Time", format_fixed_point(self.time_s)),
            ("Battery", str(int(self.battery_s))),
            ("Type", self.vehicle_type),
            ("LightToggle", format_boolean(self.light)),
            # Captures show 100 with the light off, too.
            ("LightIntensity", "100"),
            ("FrontSteer", "0"),
            ("RearSteer", "0"),
            *self._joint_pairs(),
        )

    def _joint_pairs(self) -> Pairs:
        return tuple((name, format_fixed_point(angle_rad)) for name, angle_rad in self.joints)


def _parse_joints(message: Message) -> Iterator[tuple[str, float]]:
    for name, value in message.pairs:
        # A further block that is no number is no joint: other servers append text.
        if name and name.lower() not in _STANDARD_BLOCKS and is_number(value):
            yield name, strict_fields.read_number(Message(message.word, ((name, value),)), name)


# Every reply to GETCONF; a client reads all of them as the first.
AnyConfiguration = (
    Configuration
    | VehicleConfiguration
    | RangeScannerConfiguration
    | SonarConfiguration
    | EncoderConfiguration
    | OdometryConfiguration
    | ScanIntervalConfiguration
    | TouchConfiguration
    | CameraConfiguration
    | MissionPackageConfiguration
)

Report = (
    Greeting
    | StartPoses
    | VehicleStatus
    | MissionPackageStatus
    | Reading
    | AnyConfiguration
    | Geometry
    | VehicleGeometry
    | MissionPackageGeometry
    | CommandResult
    | InitResult
    | CameraResult
    | ViewportsResult
)

_ReportParser = Callable[[Message], Report | None]

# A property of the dialect's lines and not of a report: several reports have such blocks.
_BLOCKS_WITHOUT_SPACE = {Dialect.UT2004: frozenset[str](), Dialect.UDK: UDK_BLOCKS_WITHOUT_SPACE}


def line_from_report(report: Report, dialect: Dialect = Dialect.UT2004) -> bytes:
    """Encode a report; in UDK the result may hold several lines, or none.

    Raises:
        LocalProtocolError: The report has no valid line, or one longer than clients can read.
    """
    # Several lines where UDK lists items in a line each.
    return b"".join(_encode_line(message, dialect) for message in report.to_messages(dialect))


def report_from_message(message: Message) -> Report | None:
    """Report of a message of either dialect; None for an unknown word or type.

    Raises:
        RemoteProtocolError: A field of a known report is missing or malformed; names the field.
    """
    reader = REPORT_PARSERS.get(message.word)
    return reader(message) if reader else None


def _encode_line(message: Message, dialect: Dialect) -> bytes:
    line = format_line(message.word, message.pairs, _BLOCKS_WITHOUT_SPACE[dialect])
    # An error and not a shorter line: clients would read half a list as a complete one.
    if len(line) > MAX_SERVER_LINE_BYTES:
        raise LocalProtocolError(
            f"a line of {len(line)} bytes ({line[:80]!r}...): clients read at most "
            f"{MAX_SERVER_LINE_BYTES}; send fewer items or shorter names"
        )
    return line


# ASTA is the MISSTA of UDK. CONF has one parser: clients read free pairs.
REPORT_PARSERS: dict[str, _ReportParser] = {
    "NFO": _greeting_from_message,
    "STA": VehicleStatus.from_message,
    "SEN": reading_from_message,
    "MISSTA": MissionPackageStatus.from_message,
    "ASTA": MissionPackageStatus.from_message,
    "CONF": Configuration.from_message,
    "GEO": geometry_from_message,
    "RES": result_from_message,
}

# All reports are imported from this module, so that a report can move between the files.
__all__ = [
    "AnyConfiguration",
    "CameraConfiguration",
    "CameraFov",
    "CameraResult",
    "CommandResult",
    "Configuration",
    "EncoderConfiguration",
    "EncoderReadings",
    "Geometry",
    "GeometryItem",
    "GpsReading",
    "Greeting",
    "GroundTruthReading",
    "InitResult",
    "InsReading",
    "LinkConfiguration",
    "LinkGeometry",
    "LinkStatus",
    "MissionPackageConfiguration",
    "MissionPackageGeometry",
    "MissionPackageStatus",
    "OdometryConfiguration",
    "OdometryReading",
    "RangeScanReading",
    "RangeScannerConfiguration",
    "Reading",
    "Report",
    "RfidReading",
    "ScanIntervalConfiguration",
    "SonarConfiguration",
    "SonarReadings",
    "StartPose",
    "StartPoses",
    "TachometerReading",
    "TextureRegion",
    "TouchConfiguration",
    "TouchReadings",
    "VehicleConfiguration",
    "VehicleGeometry",
    "VehicleStatus",
    "VictimPart",
    "VictimReading",
    "Viewport",
    "ViewportsResult",
    "line_from_report",
    "report_from_message",
]
