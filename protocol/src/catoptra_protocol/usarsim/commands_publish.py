"""Commands about what others see of a robot and may do with it: NOTE and SHARE. See `commands`.

Ours: a USARSim server ignores the unknown words. A parser raises RemoteProtocolError for a note
that is none: such a command is ignored.
"""

from __future__ import annotations

import base64
from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.notes import find_note_error
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import lenient_fields
from catoptra_protocol.usarsim.grammar import Message, Pairs


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
        reason = find_note_error(name, text)
        if reason:
            raise RemoteProtocolError(f"NOTE: {reason}")
        return cls(name, text)

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line.

        Raises:
            LocalProtocolError: The name or the text is no note's.
        """
        reason = find_note_error(self.name, self.text)
        if reason:
            raise LocalProtocolError(f"NOTE: {reason}")
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
