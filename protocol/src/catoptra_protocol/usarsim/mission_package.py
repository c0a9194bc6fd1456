"""Mission packages, chains of links on a robot such as a pan-tilt: MISSTA, and their CONF and GEO.

The blocks of each link follow each other, beginning with its number. UDK calls packages actuators
and their status ASTA.
"""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import Dialect, Message, Pairs, split_groups
from catoptra_protocol.usarsim.value_format import format_fixed_point, format_vector
from catoptra_protocol.vectors import Vector3

_TYPE_NAME = "MisPkg"


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """Position and torque of one joint."""

    link: int
    value: float
    """Angle in rad, or displacement of a prismatic joint in m."""
    torque: float = 0.0

    def to_pairs(self) -> Pairs:
        """Blocks of UT2004; UDK has no torque and leaves the last one out."""
        torque = format_fixed_point(self.torque, 2)
        return (
            ("Link", str(self.link)),
            ("Value", format_fixed_point(self.value)),
            ("Torque", torque),
        )


@dataclass(frozen=True, slots=True)
class MissionPackageStatus:
    """Positions of the joints of a package: MISSTA, or ASTA in UDK."""

    WORD: ClassVar[str] = "MISSTA"

    time_s: float
    name: str
    links: tuple[LinkStatus, ...]

    @classmethod
    def from_message(cls, message: Message) -> MissionPackageStatus:
        """Parse the message of a line."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            links=tuple(_parse_link_status(group) for group in split_groups(message, "Link")),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        is_udk = dialect is Dialect.UDK
        head = (("Time", format_fixed_point(self.time_s, 4 if is_udk else 2)), ("Name", self.name))
        # The torque is the last of the three pairs, so UDK's form is their beginning.
        links = (pair for link in self.links for pair in link.to_pairs()[: 2 if is_udk else 3])
        return (Message("ASTA" if is_udk else self.WORD, (*head, *links)),)


@dataclass(frozen=True, slots=True)
class LinkConfiguration:
    """Capabilities of one joint."""

    link: int
    max_speed: float
    max_torque: float
    limits: tuple[float, float] | None = None
    """Minimum and maximum; None = a free joint, printed as the range 1 to 0."""
    joint_type: str = "Revolute"

    def to_pairs(self) -> Pairs:
        """Name and value of each block."""
        # KRobot.uc treats a minimum above the maximum as no limit, and the capture prints 1 and 0.
        minimum, maximum = (
            ("1", "0") if self.limits is None else (format_fixed_point(x, 2) for x in self.limits)
        )
        return (
            ("Link", str(self.link)),
            ("JointType", self.joint_type),
            ("MaxSpeed", format_fixed_point(self.max_speed, 2)),
            ("MaxTorque", format_fixed_point(self.max_torque, 2)),
            ("MinRange", minimum),
            ("MaxRange", maximum),
        )


@dataclass(frozen=True, slots=True)
class MissionPackageConfiguration:
    """CONF of a package; a client reads the line as a `Configuration`."""

    WORD: ClassVar[str] = "CONF"

    name: str
    links: tuple[LinkConfiguration, ...]

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        links = (pair for link in self.links for pair in link.to_pairs())
        return (Message(self.WORD, (("Type", _TYPE_NAME), ("Name", self.name), *links)),)


@dataclass(frozen=True, slots=True)
class LinkGeometry:
    """Pose of one joint in the frame of its parent."""

    link: int
    parent_link: int
    """Number of the parent; -1 for the chassis."""
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""

    @classmethod
    def from_message(cls, message: Message) -> LinkGeometry:
        """Parse a message with the four fields of one link."""
        return cls(
            link=strict_fields.read_integer(message, "Link"),
            parent_link=strict_fields.read_integer(message, "ParentLink"),
            location_m=strict_fields.read_vector(message, "Location"),
            rotation_rad=strict_fields.read_vector(message, "Orientation"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block."""
        return (
            ("Link", str(self.link)),
            ("ParentLink", str(self.parent_link)),
            ("Location", format_vector(self.location_m)),
            ("Orientation", format_vector(self.rotation_rad)),
        )


@dataclass(frozen=True, slots=True)
class MissionPackageGeometry:
    """GEO of a package."""

    WORD: ClassVar[str] = "GEO"

    name: str
    links: tuple[LinkGeometry, ...]

    @classmethod
    def from_message(cls, message: Message) -> MissionPackageGeometry:
        """Parse the message of a line."""
        links = map(LinkGeometry.from_message, split_groups(message, "Link"))
        return cls(strict_fields.read_text(message, "Name"), tuple(links))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        links = (pair for link in self.links for pair in link.to_pairs())
        return (Message(self.WORD, (("Type", _TYPE_NAME), ("Name", self.name), *links)),)


def _parse_link_status(group: Message) -> LinkStatus:
    """Status in the blocks of one link; servers of UDK print no torque."""
    # Torque is 0 at rest in our server, so a missing block reads as that.
    torque = strict_fields.read_optional_number(group, "Torque") or 0.0
    return LinkStatus(
        strict_fields.read_integer(group, "Link"), strict_fields.read_number(group, "Value"), torque
    )
