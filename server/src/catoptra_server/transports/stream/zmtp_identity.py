"""Removal of the identity that a ZMTP peer chooses for itself, without sockets.

A ROUTER gives a peer without one a unique identity. Chosen ones would let a peer pass for another;
of two peers with the same one libzmq 4.3.5 never reads the second, and keeps its connection for
ever. Source: ZMTP 3.1 (rfc.zeromq.org/spec/37): a greeting of 64 bytes, then the command READY with
properties: a byte of length and the name, four bytes of length and the value.
"""

from __future__ import annotations

from catoptra_protocol.errors import RemoteProtocolError

GREETING_BYTES = 64
LONG, COMMAND = 2, 4
_READY = b"\x05READY"
_IDENTITY = b"identity"
# As long as the name it replaces; names with X- are for applications, and libzmq ignores them.
_REPLACEMENT = b"X-Unused"
# Socket type and identity are at most 300 bytes.
_MAX_READY_BYTES = 1024


class IdentityFilter:
    """The bytes of one connection with the identity made a property that nothing reads."""

    def __init__(self) -> None:
        self._greeting_bytes_left = GREETING_BYTES
        self._ready = bytearray()
        self._is_done = False

    def feed(self, data: bytes) -> bytes:
        """Bytes to pass on; those of an incomplete READY are held back.

        Raises:
            RemoteProtocolError: READY is longer than any of a DEALER.
        """
        if self._is_done:
            return data
        # Passed at once: ZeroMQ waits for a part of its peer's greeting in the middle of its own.
        greeting = data[: self._greeting_bytes_left]
        self._greeting_bytes_left -= len(greeting)
        self._ready += data[len(greeting) :]
        end = _frame_end(self._ready)
        if end > _MAX_READY_BYTES:
            raise RemoteProtocolError(f"a first command of {end} bytes")
        if not end or len(self._ready) < end:
            return greeting
        self._is_done = True
        return greeting + _replace_identity(bytes(self._ready[:end])) + bytes(self._ready[end:])


def _frame_end(data: bytes | bytearray) -> int:
    """Length of the frame that the bytes begin with, head included; 0 if its head is incomplete."""
    head_bytes = 9 if data and data[0] & LONG else 2
    if len(data) < head_bytes:
        return 0
    return head_bytes + int.from_bytes(data[1:head_bytes], "big")


def _replace_identity(frame: bytes) -> bytes:
    """The first frame with another name of its identity, if it is READY with one."""
    position = (9 if frame[0] & LONG else 2) + len(_READY)
    if not frame[0] & COMMAND or frame[position - len(_READY) : position] != _READY:
        return frame  # libzmq ends this connection
    while position < len(frame):
        name_begin, name_end = position + 1, position + 1 + frame[position]
        # Names are compared without case.
        if frame[name_begin:name_end].lower() == _IDENTITY:
            frame = frame[:name_begin] + _REPLACEMENT + frame[name_end:]
        value_bytes = int.from_bytes(frame[name_end : name_end + 4], "big")
        position = name_end + 4 + value_bytes
    return frame
