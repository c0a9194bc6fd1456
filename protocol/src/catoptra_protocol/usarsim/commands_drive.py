"""Commands that move something: DRIVE, MULTIDRIVE, MISPKG. For the table see `commands`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from catoptra_protocol.limits import MAX_NAME_CHARS
from catoptra_protocol.usarsim import lenient_fields as fields
from catoptra_protocol.usarsim.grammar import Message, Pairs, split_groups
from catoptra_protocol.usarsim.value_format import format_exact, number_from_text


class ControlOrder(IntEnum):
    """What the value of a joint's command means; the relative forms add to what is."""

    ANGLE = 0
    SPEED = 1
    TORQUE = 2
    BRAKE = 3
    RELATIVE_ANGLE = 10
    RELATIVE_SPEED = 11
    RELATIVE_TORQUE = 12


@dataclass(frozen=True, slots=True)
class Drive:
    """Set the wheel speeds of a skid-steered robot, in rad/s, or in percent if normalized.

    None leaves a side, the light or the flipping as it is.
    """

    WORD: ClassVar[str] = "DRIVE"

    left: float | None = None
    right: float | None = None
    normalized: bool = False
    light: bool | None = None
    flip: bool | None = None

    @classmethod
    def from_message(cls, message: Message) -> Drive:
        """Return the command of a parsed line."""
        return cls(
            left=fields.read_number(message, "Left"),
            right=fields.read_number(message, "Right"),
            normalized=fields.read_boolean(message, "Normalized") or False,
            light=fields.read_boolean(message, "Light"),
            flip=fields.read_boolean(message, "Flip"),
        )

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return fields.format_pairs(
            ("Left", self.left),
            ("Right", self.right),
            ("Normalized", self.normalized or None),
            ("Light", self.light),
            ("Flip", self.flip),
        )


@dataclass(frozen=True, slots=True)
class JointCommand:
    """Move one joint of the robot: to a value of the order's kind (see `Order`), and steer it.

    The order is as sent: none of `Order` means nothing. Without a value the joint stays.
    """

    name: str
    value: float | None = None
    order: int = ControlOrder.ANGLE
    steer: float | None = None


@dataclass(frozen=True, slots=True)
class DriveJoints:
    """Move joints of the robot, one or several, in this order."""

    WORD: ClassVar[str] = "DRIVE"

    joints: tuple[JointCommand, ...]

    @classmethod
    def from_message(cls, message: Message) -> DriveJoints:
        """Return the command of a parsed line; the blocks of a lone joint may precede its name."""
        named = split_groups(message, "Name")
        runs = [message] if len(named) == 1 else named
        return cls(tuple(map(_read_joint, runs)))

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return tuple(pair for joint in self.joints for pair in _joint_pairs(joint))


@dataclass(frozen=True, slots=True)
class MultiDrive:
    """Move several joints to angles, as (name, value)."""

    WORD: ClassVar[str] = "MULTIDRIVE"

    joints: tuple[tuple[str, float], ...]

    @classmethod
    def from_message(cls, message: Message) -> MultiDrive:
        """Return the command of a parsed line; a block without a name is no joint."""
        named = (pair for pair in message.pairs if pair[0])
        return cls(tuple((name[:MAX_NAME_CHARS], number_from_text(text)) for name, text in named))

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return tuple((name, format_exact(value)) for name, value in self.joints)


@dataclass(frozen=True, slots=True)
class LinkCommand:
    """Move one link of a mission package; without a value it stays."""

    link: int
    value: float | None = None
    order: int = ControlOrder.ANGLE


@dataclass(frozen=True, slots=True)
class MisPkg:
    """Move the links of a mission package, its gripper, or have it run a sequence."""

    WORD: ClassVar[str] = "MISPKG"

    name: str
    links: tuple[LinkCommand, ...] = ()
    gripper: float | None = None
    sequence: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> MisPkg:
        """Return the command of a parsed line; UDK spells the sequence out."""
        sequence = fields.read_number(message, "Seq")
        return cls(
            name=fields.read_name(message, "Name") or "",
            links=tuple(_read_link(group) for group in split_groups(message, "Link")),
            gripper=fields.read_number(message, "Gripper"),
            sequence=fields.read_number(message, "Sequence") if sequence is None else sequence,
        )

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        links = (pair for link in self.links for pair in _link_pairs(link))
        head = fields.format_pairs(("Name", self.name))
        return (
            *head,
            *links,
            *fields.format_pairs(("Gripper", self.gripper), ("Seq", self.sequence)),
        )


def drive_from_message(message: Message) -> Drive | DriveJoints:
    """Return what a DRIVE says: of joints if it names one and speaks of no side."""
    sides = (message.get("Left"), message.get("Right"))
    if fields.read_name(message, "Name") and sides == (None, None):
        return DriveJoints.from_message(message)
    return Drive.from_message(message)


def _read_joint(group: Message) -> JointCommand:
    return JointCommand(
        name=fields.read_name(group, "Name") or "",
        value=fields.read_number(group, "Value"),
        order=fields.read_integer(group, "Order") or 0,
        steer=fields.read_number(group, "Steer"),
    )


def _joint_pairs(joint: JointCommand) -> Pairs:
    order = int(joint.order) or None  # the default needs no block
    return fields.format_pairs(
        ("Name", joint.name), ("Steer", joint.steer), ("Order", order), ("Value", joint.value)
    )


def _read_link(group: Message) -> LinkCommand:
    return LinkCommand(
        link=fields.read_integer(group, "Link") or 0,
        value=fields.read_number(group, "Value"),
        order=fields.read_integer(group, "Order") or 0,
    )


def _link_pairs(link: LinkCommand) -> Pairs:
    order = int(link.order) or None  # the reference's default needs no block
    return fields.format_pairs(("Link", link.link), ("Value", link.value), ("Order", order))
