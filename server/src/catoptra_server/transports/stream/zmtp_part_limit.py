"""Limit on the parts of a ZMTP message, without sockets.

libzmq buffers all parts of a message before the application gets the first one, and limits only the
single part. Source: ZMTP 3.1 (rfc.zeromq.org/spec/37): a greeting of 64 bytes, then frames of a
byte of flags, a length of 1 or 8 bytes and a body.
"""

from __future__ import annotations

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.transports.stream.zmtp_identity import COMMAND, GREETING_BYTES, LONG

# A request is one part; with a few more the client gets an error in words, which helps its author.
MAX_PARTS = 8
_SHORT_HEAD_BYTES, _LONG_HEAD_BYTES = 2, 9
# Frames of older versions have another form.
_MIN_VERSION = 3
_MORE = 1


class ZmtpPartCounter:
    """Counter of the parts in one connection's messages, fed with its bytes."""

    def __init__(self) -> None:
        # Of the greeting or of a frame, as far as received.
        self._head = bytearray()
        self._head_bytes = GREETING_BYTES
        self._parse_head = self._read_greeting
        self._remaining_body_bytes = 0
        self._num_parts_of_message = 0  # of the one that has not ended
        self._is_last_part = False  # the frame whose body has not ended
        self.num_messages = 0
        """Complete messages so far."""
        self.num_parts = 0
        """Parts and commands so far."""

    def feed(self, data: bytes) -> None:
        """Parse the next bytes.

        Raises:
            RemoteProtocolError: The bytes must not reach libzmq.
        """
        position = 0
        while position < len(data):
            if self._remaining_body_bytes:
                consumed = min(self._remaining_body_bytes, len(data) - position)
                self._remaining_body_bytes -= consumed
                if not self._remaining_body_bytes:
                    self._end_frame()
            else:
                consumed = self._head_bytes - len(self._head)
                self._head += data[position : position + consumed]
                if len(self._head) == self._head_bytes:
                    self._parse_head()
            position += consumed

    def _read_greeting(self) -> None:
        head = self._head
        # The same test as in libzmq, which must not parse an accepted greeting as an older version.
        if head[0] != 0xFF or not head[9] & 1 or head[10] < _MIN_VERSION:
            raise RemoteProtocolError(f"no greeting of ZMTP 3: it begins {head[:11].hex(' ')}")
        self._parse_head = self._read_frame
        self._expect_frame_head()

    def _expect_frame_head(self) -> None:
        self._head.clear()
        self._head_bytes = _SHORT_HEAD_BYTES

    def _read_frame(self) -> None:
        flags = self._head[0]
        if flags & LONG and self._head_bytes == _SHORT_HEAD_BYTES:
            # The other seven bytes of the length are still to come.
            self._head_bytes = _LONG_HEAD_BYTES
            return
        self._count_part(flags)
        self._remaining_body_bytes = int.from_bytes(self._head[1:], "big")
        self._expect_frame_head()
        if not self._remaining_body_bytes:
            self._end_frame()

    def _end_frame(self) -> None:
        if self._is_last_part:
            self._is_last_part = False
            self.num_messages += 1

    def _count_part(self, flags: int) -> None:
        """Count a part. A command may stand between two parts; it ends no message."""
        self.num_parts += 1
        if flags & COMMAND:
            if flags & _MORE:
                raise RemoteProtocolError("a ZMTP command with more parts to follow")
            return
        if not flags & _MORE:
            self._num_parts_of_message = 0
            self._is_last_part = True
            return
        self._num_parts_of_message += 1
        if self._num_parts_of_message == MAX_PARTS:
            raise RemoteProtocolError(f"a message of more than {MAX_PARTS} parts")
