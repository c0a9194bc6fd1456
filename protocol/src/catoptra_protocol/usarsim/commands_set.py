"""Commands that set something up: SET, TRACE. For the table see `commands`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.usarsim import lenient_fields as fields
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.value_format import number_from_text, numbers_from_text

_NUM_VIEWPORTS = 4
_FOV_OPCODES = ("FOV", "ZOOM")


@dataclass(frozen=True, slots=True)
class Set:
    """Tell a part of the robot to do something: an opcode with parameters, as text.

    `fov_rad` is a camera's `{FOV rad}`, the form without an opcode.
    """

    WORD: ClassVar[str] = "SET"

    type: str
    name: str | None = None
    opcode: str | None = None
    params: str | None = None
    fov_rad: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> Set:
        """Return the command of a parsed line."""
        return cls(
            type=fields.read_name(message, "Type") or "",
            name=fields.read_name(message, "Name"),
            opcode=fields.read_name(message, "Opcode"),
            params=message.get("Params"),
            fov_rad=fields.read_number(message, "FOV"),
        )

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return fields.format_pairs(
            ("Type", self.type),
            ("Name", self.name),
            ("Opcode", self.opcode),
            ("Params", self.params),
            ("FOV", self.fov_rad),
        )

    def numeric_params(self) -> tuple[float, ...]:
        """Return the parameters as numbers: x,y,z,roll,pitch,yaw of an INS's POSE."""
        return numbers_from_text(self.params or "")

    def parse_fov_rad(self) -> float | None:
        """Return the field of view asked for in either form; 0 means the default, None none."""
        if self.fov_rad is None and (self.opcode or "").upper() in _FOV_OPCODES:
            return number_from_text(self.params or "")
        return self.fov_rad


@dataclass(frozen=True, slots=True)
class SetViewports:
    """Choose which camera fills which quarter of the picture; None leaves one as it is.

    The arrangement is `SingleView` or `QuadView`; a camera called `Disable` shows nothing.
    """

    WORD: ClassVar[str] = "SET"

    config: str | None = None
    cameras: tuple[str | None, ...] = (None,) * _NUM_VIEWPORTS

    @classmethod
    def from_message(cls, message: Message) -> SetViewports:
        """Return the command of a parsed line."""
        cameras = (fields.read_name(message, f"Viewport{i + 1}") for i in range(_NUM_VIEWPORTS))
        return cls(fields.read_name(message, "Config"), tuple(cameras))

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        viewports = ((f"Viewport{i + 1}", camera) for i, camera in enumerate(self.cameras))
        return fields.format_pairs(("Type", "Viewports"), ("Config", self.config), *viewports)


@dataclass(frozen=True, slots=True)
class Trace:
    """Draw a trail behind the robot, a mark each so many seconds; the colour is one of seven."""

    WORD: ClassVar[str] = "TRACE"

    enabled: bool = False
    interval_s: float | None = None
    colour: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> Trace:
        """Return the command of a parsed line."""
        return cls(
            enabled=fields.read_boolean(message, "On") or False,
            interval_s=fields.read_number(message, "Interval"),
            colour=fields.read_name(message, "Color"),
        )

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return fields.format_pairs(
            ("On", self.enabled), ("Interval", self.interval_s), ("Color", self.colour)
        )


def set_from_message(message: Message) -> Set | SetViewports:
    """Return what a SET says: of the viewports, or of any other part."""
    is_viewports = (message.get("Type") or "").lower() == "viewports"
    return SetViewports.from_message(message) if is_viewports else Set.from_message(message)
