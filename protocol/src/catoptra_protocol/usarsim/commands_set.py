"""Setting commands: SET, TRACE. For the table see `commands`."""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.limits import MAX_COMMAND_NUMBER
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import lenient_fields
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.value_format import number_from_text, numbers_from_text

_NUM_VIEWPORTS = 4
_FOV_OPCODES = ("FOV", "ZOOM")


@dataclass(frozen=True, slots=True)
class Set:
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
    def from_message(cls, message: Message) -> Set:
        """Parse the message of a line."""
        return cls(
            type=lenient_fields.read_name(message, "Type") or "",
            name=lenient_fields.read_name(message, "Name"),
            opcode=lenient_fields.read_name(message, "Opcode"),
            params=message.get("Params"),
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


def set_from_message(message: Message) -> Set | SetViewports:
    """Parse a SET: of the viewports, or of any other part."""
    # Viewports have no name and opcode, so their SET has a class of its own.
    is_viewports = (message.get("Type") or "").lower() == "viewports"
    return SetViewports.from_message(message) if is_viewports else Set.from_message(message)
