"""What a ZeroMQ peer sends, read just far enough to see a message that does not end. No sockets.

libzmq keeps all parts of a message before anybody sees it, and limits only the single part. Source:
ZMTP 3.1 (rfc.zeromq.org/spec/37): a greeting of 64 bytes, then frames of a byte of flags, a length
of 1 or 8 bytes and a body.
"""

from __future__ import annotations

from catoptra_protocol.errors import RemoteProtocolError

# A request is one part; a few more are refused in words, which helps who writes a client.
MAX_PARTS = 8
_GREETING_BYTES = 64
_SHORT_HEAD_BYTES, _LONG_HEAD_BYTES = 2, 9
# Older peers have frames of another form.
_MIN_VERSION = 3
_MORE, _LONG, _COMMAND = 1, 2, 4


class ZmtpPartCounter:
    """Counts the parts of one connection's messages as its bytes come."""

    def __init__(self) -> None:
        self._head = bytearray()  # of the greeting or of a frame, as far as it came
        self._head_bytes = _GREETING_BYTES
        self._parse_head = self._read_greeting
        self._body_bytes = 0  # still to come
        self._parts = 0  # of the message that has not ended

    def feed(self, data: bytes) -> None:
        """Take the next bytes. Raises RemoteProtocolError if they must not reach libzmq."""
        at = 0
        while at < len(data):
            if self._body_bytes:
                taken = min(self._body_bytes, len(data) - at)
                self._body_bytes -= taken
            else:
                taken = self._head_bytes - len(self._head)
                self._head += data[at : at + taken]
                if len(self._head) == self._head_bytes:
                    self._parse_head()
            at += taken

    def _read_greeting(self) -> None:
        head = self._head
        # As libzmq tells versions apart: it must not take for an older one what passes here.
        if head[0] != 0xFF or not head[9] & 1 or head[10] < _MIN_VERSION:
            raise RemoteProtocolError(f"no greeting of ZMTP 3: it begins {head[:11].hex(' ')}")
        self._parse_head = self._read_frame
        self._expect_frame_head()

    def _expect_frame_head(self) -> None:
        self._head.clear()
        self._head_bytes = _SHORT_HEAD_BYTES

    def _read_frame(self) -> None:
        flags = self._head[0]
        if flags & _LONG and self._head_bytes == _SHORT_HEAD_BYTES:
            self._head_bytes = _LONG_HEAD_BYTES
            return
        self._count_part(flags)
        self._body_bytes = int.from_bytes(self._head[1:], "big")
        self._expect_frame_head()

    def _count_part(self, flags: int) -> None:
        """Count a part. A command may stand between two parts; it ends no message."""
        if flags & _COMMAND:
            if flags & _MORE:
                raise RemoteProtocolError("a ZMTP command with more parts to follow")
            return
        self._parts = self._parts + 1 if flags & _MORE else 0
        if self._parts == MAX_PARTS:
            raise RemoteProtocolError(f"a message of more than {MAX_PARTS} parts")
