"""ZMTP between a stream server and one of its clients: bytes to messages, messages to parts.

For the mutation proxy, which passes on TCP, so that a connection ends on both sides at once.
Source: ZMTP 3.1, https://rfc.zeromq.org/spec/37.
"""

from __future__ import annotations

_GREETING_BYTES = 64
_MORE, _LONG, _COMMAND = 1, 2, 4


class ZmtpSplitter:
    """Splits one direction of a connection into messages; each command is a message, too.

    The greeting passes in any pieces: either side waits for the beginning of the other's.
    """

    def __init__(self) -> None:
        self._greeting_left = _GREETING_BYTES

    def __call__(self, data: bytes) -> tuple[list[bytes], bytes]:
        """Whole messages of the bytes that arrived, and the rest."""
        messages = []
        if self._greeting_left and data:
            messages.append(data[: self._greeting_left])
            data = data[self._greeting_left :]
            self._greeting_left -= len(messages[0])
        while (end := _find_message_end(data)) is not None:
            messages.append(data[:end])
            data = data[end:]
        return messages, data


def is_command(message: bytes) -> bool:
    """Whether a message is a command, such as READY."""
    return bool(message[0] & _COMMAND)


def parts_from_message(message: bytes) -> list[bytes]:
    """Parts of a message."""
    parts = []
    while message:
        start, end = _find_body(message)
        parts.append(message[start:end])
        message = message[end:]
    return parts


def message_from_parts(parts: list[bytes]) -> bytes:
    """Message of these parts."""
    frames = []
    for number, part in enumerate(parts, 1):
        more = _MORE if number < len(parts) else 0
        frames.append(bytes([_LONG | more]) + len(part).to_bytes(8, "big") + part)
    return b"".join(frames)


def _find_message_end(data: bytes) -> int | None:
    """Number of bytes of the first message; None if it is incomplete."""
    position, has_more = 0, True
    while has_more:
        header = data[position : position + 9]
        # The length has one byte or eight.
        if len(header) < 2 or (header[0] & _LONG and len(header) < 9):
            return None
        has_more = bool(header[0] & _MORE)
        position += _find_body(header)[1]
        if position > len(data):
            return None
    return position


def _find_body(frame: bytes) -> tuple[int, int]:
    """Start and end of the body of the first frame."""
    start = 9 if frame[0] & _LONG else 2
    return start, start + int.from_bytes(frame[1:start], "big")
