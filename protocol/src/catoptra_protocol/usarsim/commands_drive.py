"""Motion commands: DRIVE, MULTIDRIVE, MISPKG. For the table see `commands`.

Parsers raise RemoteProtocolError for a number beyond MAX_COMMAND_NUMBER and for more than
MAX_COMMAND_JOINTS joints or links: such a command is ignored whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import ClassVar

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.limits import MAX_COMMAND_JOINTS
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import lenient_fields
from catoptra_protocol.usarsim.grammar import Message, Pairs, split_groups
from catoptra_protocol.usarsim.value_format import format_exact


class ControlOrder(IntEnum):
    """Quantity of a joint's value; the relative orders add to the present value."""

    ANGLE = 0
    SPEED = 1
    TORQUE = 2
    BRAKE = 3
    RELATIVE_ANGLE = 10
    RELATIVE_SPEED = 11
    RELATIVE_TORQUE = 12


@dataclass(frozen=True, slots=True)
class Drive:
    """Set the wheel speeds of a skid-steered robot; None leaves a value unchanged."""

    WORD: ClassVar[str] = "DRIVE"

    left: float | None = None
    """Speed in rad/s, or in percent of the maximum if normalized."""
    right: float | None = None
    """As `left`."""
    normalized: bool = False
    light: bool | None = None
    flip: bool | None = None
    """Accepted for compatibility; no robot here can be turned over."""
    halt_after_s: float | None = None
    """Time, s, after which the robot halts unless another command sets its speeds; None: never."""

    @classmethod
    def from_message(cls, message: Message) -> Drive:
        """Parse the message of a line."""
        return cls(
            left=lenient_fields.read_set_point(message, "Left"),
            right=lenient_fields.read_set_point(message, "Right"),
            normalized=lenient_fields.read_boolean(message, "Normalized") or False,
            light=lenient_fields.read_boolean(message, "Light"),
            flip=lenient_fields.read_boolean(message, "Flip"),
            halt_after_s=lenient_fields.read_number(message, "HaltAfter"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(
            ("Left", self.left),
            ("Right", self.right),
            ("Normalized", self.normalized or None),
            ("Light", self.light),
            ("Flip", self.flip),
            ("HaltAfter", self.halt_after_s),
        )


@dataclass(frozen=True, slots=True)
class JointCommand:
    """Motion of one joint of the robot."""

    name: str
    value: float | None = None
    """In the unit of the order; None leaves the joint unchanged."""
    order: int = ControlOrder.ANGLE
    """As sent; a number outside ControlOrder has no effect."""
    steer: float | None = None
    """Angle of a steered wheel."""


@dataclass(frozen=True, slots=True)
class DriveJoints:
    """Move joints of the robot, one or several, in this order."""

    WORD: ClassVar[str] = "DRIVE"

    joints: tuple[JointCommand, ...]

    @classmethod
    def from_message(cls, message: Message) -> DriveJoints:
        """Parse a line; the blocks of a single joint may precede its name."""
        groups = split_groups(message, "Name")
        runs = [message] if len(groups) == 1 else groups
        _check_count(runs)
        return cls(tuple(map(_read_joint, runs)))

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return tuple(pair for joint in self.joints for pair in _joint_pairs(joint))


@dataclass(frozen=True, slots=True)
class MultiDrive:
    """Move several joints to angles."""

    WORD: ClassVar[str] = "MULTIDRIVE"

    joints: tuple[tuple[str, float], ...]
    """Pairs of name and value."""

    @classmethod
    def from_message(cls, message: Message) -> MultiDrive:
        """Parse a line; a block without a name is no joint."""
        joints = [pair for pair in message.pairs if pair[0]]
        _check_count(joints)
        return cls(
            tuple(
                (lenient_fields.printable_name(name), lenient_fields.set_point_from_text(text))
                for name, text in joints
            )
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return tuple((name, format_exact(value)) for name, value in self.joints)


@dataclass(frozen=True, slots=True)
class LinkCommand:
    """Motion of one link of a mission package."""

    link: int
    value: float | None = None
    """In the unit of the order; None leaves the link unchanged."""
    order: int = ControlOrder.ANGLE


@dataclass(frozen=True, slots=True)
class MisPkg:
    """Move the links or the gripper of a mission package, or start a sequence."""

    WORD: ClassVar[str] = "MISPKG"

    name: str
    links: tuple[LinkCommand, ...] = ()
    gripper: float | None = None
    sequence: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> MisPkg:
        """Parse a line; UDK writes `Sequence` in full."""
        sequence = lenient_fields.read_set_point(message, "Seq")
        # split_groups ignores the blocks before the first Link, the package's own name among them.
        groups = split_groups(message, "Link")
        _check_count(groups)
        return cls(
            name=lenient_fields.read_name(message, "Name") or "",
            links=tuple(map(_read_link, groups)),
            gripper=lenient_fields.read_set_point(message, "Gripper"),
            sequence=lenient_fields.read_set_point(message, "Sequence")
            if sequence is None
            else sequence,
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        links = (pair for link in self.links for pair in _link_pairs(link))
        head = lenient_fields.format_pairs(("Name", self.name))
        return (
            *head,
            *links,
            *lenient_fields.format_pairs(("Gripper", self.gripper), ("Seq", self.sequence)),
        )


def drive_from_message(message: Message) -> Drive | DriveJoints:
    """Parse a DRIVE: of joints if the line has a Name and neither side, else of wheels."""
    sides = (message.get("Left"), message.get("Right"))
    # A side takes precedence over a name: no source has both (SPEC-NOTES.md, 5).
    if lenient_fields.read_name(message, "Name") and sides == (None, None):
        return DriveJoints.from_message(message)
    return Drive.from_message(message)


def _check_count(joints: Sequence[object]) -> None:
    if len(joints) > MAX_COMMAND_JOINTS:
        raise RemoteProtocolError(
            f"{len(joints)} joints in one command: the limit is {MAX_COMMAND_JOINTS}"
        )


def _read_joint(group: Message) -> JointCommand:
    return JointCommand(
        name=lenient_fields.read_name(group, "Name") or "",
        value=lenient_fields.read_set_point(group, "Value"),
        order=lenient_fields.read_integer(group, "Order") or 0,
        steer=lenient_fields.read_set_point(group, "Steer"),
    )


def _joint_pairs(joint: JointCommand) -> Pairs:
    # The default order needs no block.
    order = int(joint.order) or None
    return lenient_fields.format_pairs(
        ("Name", joint.name), ("Steer", joint.steer), ("Order", order), ("Value", joint.value)
    )


def _read_link(group: Message) -> LinkCommand:
    return LinkCommand(
        link=lenient_fields.read_integer(group, "Link") or 0,
        value=lenient_fields.read_set_point(group, "Value"),
        order=lenient_fields.read_integer(group, "Order") or 0,
    )


def _link_pairs(link: LinkCommand) -> Pairs:
    # The default order of the reference needs no block.
    order = int(link.order) or None
    return lenient_fields.format_pairs(("Link", link.link), ("Value", link.value), ("Order", order))
