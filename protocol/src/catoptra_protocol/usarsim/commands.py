"""The commands of a control client: one frozen dataclass each, and their table COMMAND_PARSERS.

Spawning, queries, STEP, the settings SET and TRACE, motion (DRIVE, MULTIDRIVE, MISPKG), and two of
our own, NOTE and SHARE: a USARSim server ignores unknown words. A missing or malformed field
becomes None, 0 or an empty text, never an error. Only a malformed note, and a motion command with a
number beyond MAX_COMMAND_NUMBER or more than MAX_COMMAND_JOINTS joints or links, are no command:
parsers raise RemoteProtocolError, and such a command is ignored whole.

To add a command: its class beside similar ones (WORD, fields, `from_message`, `to_pairs`), its
entries in the `Command` union and in COMMAND_PARSERS, a vector in tests/conformance/data/commands,
its row in SPEC.md; then its case in the simulation.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_COMMAND_JOINTS, MAX_COMMAND_NUMBER
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import lenient_fields
from catoptra_protocol.usarsim.grammar import Message, Pairs, format_line, split_groups
from catoptra_protocol.usarsim.value_format import format_exact, number_from_text, numbers_from_text
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class Note:
    """Publish a note about the robot, in place of the one of the same name."""

    WORD: ClassVar[str] = "NOTE"

    name: str
    text: str
    """A JSON object."""

    @classmethod
    def from_message(cls, message: Message) -> Note:
        """Parse the message of a line."""
        name = message.get("Name") or ""
        try:
            # Base64, since braces end the blocks of a line.
            text = base64.b64decode(message.get("Data") or "", validate=True).decode()
        except ValueError as error:  # wrong Base64, or no UTF-8 in it
            raise RemoteProtocolError(f"NOTE {{Data}}: {error}") from error
        from catoptra_protocol.notes import check_note

        try:
            check_note(name, text)
        except LocalProtocolError as error:
            raise RemoteProtocolError(f"NOTE: {error}") from error
        return cls(name, text)

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line.

        Raises:
            LocalProtocolError: The name or the text is no note's.
        """
        from catoptra_protocol.notes import check_note

        try:
            check_note(self.name, self.text)
        except LocalProtocolError as error:
            raise LocalProtocolError(f"NOTE: {error}") from error
        data = base64.b64encode(self.text.encode()).decode("ascii")
        return (("Name", self.name), ("Data", data))


@dataclass(frozen=True, slots=True)
class ShareControl:
    """Let other clients drive the robot, or no longer."""

    WORD: ClassVar[str] = "SHARE"

    shared: bool

    @classmethod
    def from_message(cls, message: Message) -> ShareControl:
        """Parse a line; without a field the control is not shared."""
        return cls(lenient_fields.read_boolean(message, "Control") or False)

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(("Control", self.shared))


_NUM_VIEWPORTS = 4
_FOV_OPCODES = ("FOV", "ZOOM")


@dataclass(frozen=True, slots=True)
class SetCommand:
    """Setting of a part of the robot: an opcode with parameters."""

    WORD: ClassVar[str] = "SET"

    type: str
    """Type of the part; empty if missing."""
    name: str | None = None
    opcode: str | None = None
    params: str | None = None
    """Parameters as text; their meaning depends on type and opcode."""
    fov_rad: float | None = None
    """The {FOV rad} of a camera, the form without an opcode."""

    @classmethod
    def from_message(cls, message: Message) -> SetCommand:
        """Parse the message of a line."""
        return cls(
            type=lenient_fields.read_name(message, "Type") or "",
            name=lenient_fields.read_name(message, "Name"),
            opcode=lenient_fields.read_name(message, "Opcode"),
            params=lenient_fields.read_text(message, "Params"),
            fov_rad=lenient_fields.read_number(message, "FOV"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(
            ("Type", self.type),
            ("Name", self.name),
            ("Opcode", self.opcode),
            ("Params", self.params),
            ("FOV", self.fov_rad),
        )

    @property
    def numeric_params(self) -> tuple[float, ...]:
        """Parameters as numbers: x,y,z,roll,pitch,yaw of POSE for an INS.

        Empty if one of them exceeds MAX_COMMAND_NUMBER, so that SET reports Failed.
        """
        # Separated like vectors (SPEC.md 3), of which POSE has two.
        numbers = numbers_from_text(self.params or "")
        return numbers if all(abs(x) <= MAX_COMMAND_NUMBER for x in numbers) else ()

    def parse_fov_rad(self) -> float | None:
        """Field of view in either form: 0 means the default, None no field of view."""
        # The explicit {FOV} takes precedence over an opcode.
        if self.fov_rad is None and (self.opcode or "").upper() in _FOV_OPCODES:
            return number_from_text(self.params or "")
        return self.fov_rad


@dataclass(frozen=True, slots=True)
class SetViewports:
    """Assignment of cameras to the quarters of the image-port picture."""

    WORD: ClassVar[str] = "SET"

    config: str | None = None
    """`SingleView` or `QuadView`; None leaves the arrangement unchanged."""
    cameras: tuple[str | None, ...] = (None,) * _NUM_VIEWPORTS
    """Camera of each quarter; `Disable` shows none, None leaves a quarter unchanged."""

    @classmethod
    def from_message(cls, message: Message) -> SetViewports:
        """Parse the message of a line."""
        # Viewports count from 1 on the wire.
        cameras = (
            lenient_fields.read_name(message, f"Viewport{i + 1}") for i in range(_NUM_VIEWPORTS)
        )
        return cls(lenient_fields.read_name(message, "Config"), tuple(cameras))

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        viewports = ((f"Viewport{i + 1}", camera) for i, camera in enumerate(self.cameras))
        return lenient_fields.format_pairs(
            ("Type", "Viewports"), ("Config", self.config), *viewports
        )


@dataclass(frozen=True, slots=True)
class Trace:
    """Draw a trail of marks behind the robot."""

    WORD: ClassVar[str] = "TRACE"

    enabled: bool = False
    interval_s: float | None = None
    """Time between two marks; None = the default."""
    colour: str | None = None
    """One of seven colours (SPEC.md 5.8); None = the default."""

    @classmethod
    def from_message(cls, message: Message) -> Trace:
        """Parse the message of a line."""
        return cls(
            enabled=lenient_fields.read_boolean(message, "On") or False,
            interval_s=lenient_fields.read_number(message, "Interval"),
            colour=lenient_fields.read_name(message, "Color"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(
            ("On", self.enabled), ("Interval", self.interval_s), ("Color", self.colour)
        )


def _set_from_message(message: Message) -> SetCommand | SetViewports:
    """Parse a SET: of the viewports, or of any other part."""
    # Viewports have no name and opcode, so their SET has a class of its own.
    is_viewports = (message.get("Type") or "").lower() == "viewports"
    return SetViewports.from_message(message) if is_viewports else SetCommand.from_message(message)


@dataclass(frozen=True, slots=True)
class Init:
    """Spawn a robot of a class at a location or at a start pose; the location takes precedence."""

    WORD: ClassVar[str] = "INIT"

    class_name: str
    """Class of the robot; package optional, any case."""
    name: str | None = None
    """Requested name; None lets the server choose."""
    location_m: Vector3 | None = None
    """Position in the world frame."""
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw in the world frame."""
    start: str | None = None
    """Name of a start pose."""

    @classmethod
    def from_message(cls, message: Message) -> Init:
        """Parse the message of a line."""
        return cls(
            # An INIT without a class goes on to the simulation, which logs the reason of each
            # rejection.
            class_name=lenient_fields.read_name(message, "ClassName") or "",
            name=lenient_fields.read_name(message, "Name"),
            location_m=_read_location(message),
            rotation_rad=lenient_fields.read_vector(message, "Rotation") or (0.0, 0.0, 0.0),
            start=lenient_fields.read_name(message, "Start"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(
            ("ClassName", self.class_name),
            ("Name", self.name),
            ("Location", self.location_m),
            # 0,0,0 is the default of every server (SPEC.md 4.3) and needs no block.
            ("Rotation", self.rotation_rad if any(self.rotation_rad) else None),
            ("Start", self.start),
        )


@dataclass(frozen=True, slots=True)
class GetConf:
    """Query the configuration of the robot, or of all sensors of a type, or of one of them."""

    WORD: ClassVar[str] = "GETCONF"

    type: str
    name: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> GetConf:
        """Parse the message of a line."""
        return cls(
            lenient_fields.read_name(message, "Type") or "",
            lenient_fields.read_name(message, "Name"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetGeo:
    """Query the poses of sensors of a type, or of one of them; or the dimensions of the robot."""

    WORD: ClassVar[str] = "GETGEO"

    type: str
    name: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> GetGeo:
        """Parse the message of a line."""
        return cls(
            lenient_fields.read_name(message, "Type") or "",
            lenient_fields.read_name(message, "Name"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetStartPoses:
    """Query the named start poses of the world."""

    WORD: ClassVar[str] = "GETSTARTPOSES"

    @classmethod
    def from_message(cls, message: Message) -> GetStartPoses:
        """Parse a line; its parameters, if any, are ignored."""
        return cls()

    def to_pairs(self) -> Pairs:
        """No blocks."""
        return ()


@dataclass(frozen=True, slots=True)
class StepCommand:
    """Advance a lockstep clock. Ours: a USARSim server ignores the unknown word."""

    WORD: ClassVar[str] = "STEP"

    time_s: float

    @classmethod
    def from_message(cls, message: Message) -> StepCommand:
        """Parse a line; without a time the step is 0 s."""
        # 0 s is a valid step: it reads the sensors without any time passing (SPEC.md 6).
        return cls(lenient_fields.read_number(message, "Time") or 0.0)

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return (("Time", format_exact(self.time_s)),)


@dataclass(frozen=True, slots=True)
class Stepper:
    """Declare that this connection advances the lockstep clock, also without a robot. Ours."""

    WORD: ClassVar[str] = "STEPPER"

    @classmethod
    def from_message(cls, message: Message) -> Stepper:
        """Parse a line; the command has no fields."""
        return cls()

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return ()


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
    """Whether to turn a robot that has fallen onto its wheels again."""
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


def _drive_from_message(message: Message) -> Drive | DriveJoints:
    """Parse a DRIVE: of joints if the line has a Name and neither side, else of wheels."""
    sides = (message.get("Left"), message.get("Right"))
    # A side takes precedence over a name: no source has both (SPEC-NOTES.md, 5).
    if lenient_fields.read_name(message, "Name") and sides == (None, None):
        return DriveJoints.from_message(message)
    return Drive.from_message(message)


Command = (
    Init
    | Drive
    | DriveJoints
    | MultiDrive
    | MisPkg
    | SetCommand
    | SetViewports
    | Trace
    | GetConf
    | GetGeo
    | GetStartPoses
    | StepCommand
    | Stepper
    | Note
    | ShareControl
)

# A word may have several classes: the parsers of DRIVE and SET decide by the fields.
COMMAND_PARSERS: dict[str, Callable[[Message], Command]] = {
    "INIT": Init.from_message,
    "DRIVE": _drive_from_message,
    "MULTIDRIVE": MultiDrive.from_message,
    "MISPKG": MisPkg.from_message,
    # The word of UDK's later releases.
    "ACT": MisPkg.from_message,
    "SET": _set_from_message,
    "TRACE": Trace.from_message,
    "GETCONF": GetConf.from_message,
    "GETGEO": GetGeo.from_message,
    "GETSTARTPOSES": GetStartPoses.from_message,
    "STEP": StepCommand.from_message,
    "STEPPER": Stepper.from_message,
    "NOTE": Note.from_message,
    "SHARE": ShareControl.from_message,
}


def command_from_message(message: Message) -> Command | None:
    """Command of a message; None for one that the server ignores.

    These are an unknown word, a motion command with a number or a count beyond all limits, and a
    malformed note.
    """
    reader = COMMAND_PARSERS.get(message.word)
    try:
        return reader(message) if reader else None
    except RemoteProtocolError:
        return None


def line_from_command(command: Command) -> bytes:
    """Line of a command with its line end, numbers exact.

    Raises:
        LocalProtocolError: A text would break the line, a number is not finite, or a note is none.
    """
    return format_line(command.WORD, command.to_pairs())


def _read_location(message: Message) -> Vector3 | None:
    """Location of an INIT, or the {X} {Y} {Z} that GameBots accepts instead."""
    location = lenient_fields.read_vector(message, "Location")
    if location is not None:
        return location
    # One of the three suffices, as in GameBots; the others are 0.
    x, y, z = (lenient_fields.read_number(message, key) for key in ("X", "Y", "Z"))
    return None if x is None and y is None and z is None else (x or 0.0, y or 0.0, z or 0.0)


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
