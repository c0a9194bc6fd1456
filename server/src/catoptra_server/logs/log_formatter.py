"""Lines of the log: one record is one line, with continuation lines indented.

Names and messages come from clients. Their control characters are escaped: a terminal that shows
the log obeys escape sequences, and a line break could begin a forged line.
"""

from __future__ import annotations

import logging

# C0 without the line break, DEL and C1; then line separators and marks of the writing direction,
# which change the order of the characters in a terminal.
_CONTROL_CODES = (
    *(code for code in range(0x20) if code != 0x0A),
    *range(0x7F, 0xA0),
    *(0x200E, 0x200F, 0x2028, 0x2029),
    *range(0x202A, 0x202F),
    *range(0x2066, 0x206A),
)
_ESCAPES = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _CONTROL_CODES}
_CONTINUATION = "\n    "


class LogFormatter(logging.Formatter):
    """Time, level, logger and message of a record; its traceback in indented lines."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Text of a record without control characters, and without the last line break."""
        return escape_controls(super().format(record)).replace("\n", _CONTINUATION)


def escape_controls(text: str) -> str:
    r"""Text with control characters other than the line break escaped, such as \x1b."""
    return text.translate(_ESCAPES)
