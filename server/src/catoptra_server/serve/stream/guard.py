"""The public port of the stream: a relay to the private ROUTER that limits what clients can use.

Bytes pass both ways over a local socket that only this user can open, unchanged but for the
identity of a client. What ZeroMQ does not limit ends or waits here:

* **A message without an end.** libzmq buffers all parts of a message before the application gets
  the first, and limits only the single part. `ZmtpPartCounter` counts parts: 2 MB under four
  attackers, against 100 MB where byte counters are watched
  (`tests/measurements/unterminated_messages.py`).
* **A chosen identity** would let a peer pass for another; of two peers with the same one libzmq
  4.3.5 never reads the second, and keeps the connection for ever. `IdentityFilter` renames the
  property, and the ROUTER gives the peer a unique identity.
* **A frame** is written to the client's socket itself, between two messages of the ROUTER: through
  ZeroMQ it was copied three times more, and took 2.4 ms of processor time instead of 0.8 (1024 px).
* **A flood, or a connection without a request.** At most one read per direction is buffered: bytes
  that the ROUTER does not accept stay in the client's TCP connection, and vice versa.

Source: ZMTP 3.1 (rfc.zeromq.org/spec/37): a greeting of 64 bytes, then frames of a byte of flags, a
length of 1 or 8 bytes and a body; the first is the command READY with properties, each a byte of
length and the name, four bytes of length and the value.
"""

from __future__ import annotations

import asyncio
import logging
import math
import re
import select
import socket
import struct
import sys
from collections.abc import Callable, Sequence

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.frames.frame import Payload
from catoptra_server.serve.limits import MAX_PARTS, NEWCOMER_AGE_S, LoopAccount
from catoptra_server.serve.port import (
    CHECK_INTERVAL_S,
    ConnectionLimits,
    Port,
    set_vanished_timeout,
)

log = logging.getLogger(__name__)
_GREETING_BYTES = 64
_SIGNATURE = re.compile(rb"\xff\0{0,7}\Z|\xff\0{7}[\0\1](\x7f|\Z)")
_LONG, _COMMAND = 2, 4
_MORE = 1
_SHORT_HEAD_BYTES, _LONG_HEAD_BYTES = 2, 9
# Frames of older versions have another form.
_MIN_VERSION = 3
_READY = b"\x05READY"
_IDENTITY = b"identity"
# As long as the name it replaces; names with X- are for applications, ignored by libzmq.
_REPLACEMENT = b"X-Unused"
# Socket type and identity are at most 300 bytes.
_MAX_READY_BYTES = 1024
# Requests are small: one read has a few, so that a flood is held back before it has cost
# much.
_UPSTREAM_READ_BYTES = 1024
# A frame should take few turns of the loop; a client that reads nothing holds one read.
_DOWNSTREAM_READ_BYTES = 128 * 1024
# Time of the thread of ZeroMQ for a request, beside the loop's own, which is measured; for a part,
# and for a read.
_MESSAGE_COST_S = 50e-6
_PART_COST_S = 2e-6
_READ_COST_S = 50e-6
# A read of the smallest messages costs 0.1 s, and ten thousand seconds of a flood of many clients.
_MAX_WAIT_S = 60.0
# Receives the bytes of a read; returns those to relay, and the time in seconds until the next read.
# A RemoteProtocolError ends the connection.
_InspectBytes = Callable[[bytes], tuple[bytes, float]]
_EndCallback = Callable[[Exception | None], None]


class ConnectionGuard:
    """The connections of a listening socket to the Unix socket at a path."""

    def __init__(self, listener: socket.socket, path: str, *, limits: ConnectionLimits) -> None:
        """Begin to accept connections.

        Args:
            listener: Listening socket, which the guard owns from now on.
            path: Path of the ROUTER's socket.
            limits: Number of connections, and time for the first request; there is no limit of
                idleness, since TCP checks idle connections.
        """
        self._loop = asyncio.get_running_loop()
        self._path = path
        self._limits = limits
        self._port = Port(
            listener, self._open, name="stream", limits=limits, first_bytes=_SIGNATURE
        )
        self._of_name: dict[bytes | str, GuardedConnection] = {}
        self._check = self._loop.call_later(CHECK_INTERVAL_S, self._check_connections)

    def close(self) -> None:
        """Release the port and close every connection."""
        self._port.close()
        self._check.cancel()
        for connection in self._port:
            connection.end()

    def find_connection(self, router_end: socket.socket) -> GuardedConnection | None:
        """Connection whose bytes arrive at a socket of the ROUTER."""
        name = router_end.getpeername()
        # Elsewhere all have an empty one.
        return self._of_name.get(name) if name else None

    def _open(self, client_socket: socket.socket, address: str) -> GuardedConnection:
        set_vanished_timeout(client_socket)
        router_socket = socket.socket(socket.AF_UNIX)
        try:
            # Linux gives the socket a name, by which the ROUTER's end is recognised.
            if sys.platform == "linux":
                router_socket.bind("")
            router_socket.setblocking(False)
            router_socket.connect(self._path)
        except OSError:
            router_socket.close()
            raise
        name = router_socket.getsockname()

        def forget(connection: GuardedConnection) -> None:
            self._port.remove(connection)
            self._of_name.pop(name, None)

        self._of_name[name] = connection = GuardedConnection(
            client_socket,
            router_socket,
            address=address,
            account=self._limits.loop_share.open_account(address, max_wait_s=_MAX_WAIT_S),
            on_close=forget,
        )
        return connection

    def _check_connections(self) -> None:
        self._check = self._loop.call_later(CHECK_INTERVAL_S, self._check_connections)
        self._close_orphans()

    def _close_orphans(self) -> None:
        """Close connections whose end of the ROUTER is shut down while the client reads nothing."""
        blocked = {one.router_fd: one for one in self._port if one.is_client_blocked}
        poll = select.poll()
        for descriptor in blocked:
            poll.register(descriptor, 0)  # hang-ups and errors are always reported
        for descriptor, _ in poll.poll(0):
            blocked[descriptor].end()


class GuardedConnection:
    """The two sockets of one client; both end when either does."""

    has_left = False
    """Nothing is relayed for a client that has closed either direction."""

    def __init__(
        self,
        client_socket: socket.socket,
        router_socket: socket.socket,
        *,
        address: str,
        account: LoopAccount,
        on_close: Callable[[GuardedConnection], object],
    ) -> None:
        self._sockets = (client_socket, router_socket)
        self.address = address
        self._loop = asyncio.get_running_loop()
        self.opened_at_s = self._loop.time()
        self.account = account
        """Use of the event loop."""
        self.has_robot: Callable[[], bool] = lambda: False
        """Whether the client has a robot; set by the server of the clients."""
        self.is_dialogue = True
        """Whether the client waited for the replies at the time of its last input."""
        self._on_close = on_close
        self._counter = ZmtpPartCounter()
        self._reply_counter = ZmtpPartCounter(max_parts=sys.maxsize)
        self._identity_filter = IdentityFilter()
        # Whether ZeroMQ has sent anything since the last read from the client.
        self._has_replied = True
        self._requested_at_s = -math.inf
        self._upstream = Relay(
            client_socket,
            router_socket,
            read_bytes=_UPSTREAM_READ_BYTES,
            inspect=self._inspect,
            on_end=self._close_on_error,
        )
        self._downstream = Relay(
            router_socket,
            client_socket,
            read_bytes=_DOWNSTREAM_READ_BYTES,
            inspect=self._note_reply,
            on_end=self._close_on_error,
        )

    def send(self, parts: Sequence[Payload]) -> bool:
        """Send a message past the ROUTER, at once or not at all, without a copy.

        Returns:
            False while other bytes wait for the client, or a message of the ROUTER is on its way.
        """
        if self.is_client_blocked or not self._reply_counter.is_between_messages:
            return False
        self._has_replied = True
        self._downstream.insert(_make_frames(parts))
        return True

    @property
    def is_closed(self) -> bool:
        """Whether the connection has ended."""
        return self.router_fd < 0

    @property
    def has_handshake(self) -> bool:
        """Whether the client has sent a whole message."""
        return self._counter.num_messages > 0

    @property
    def is_in_use(self) -> bool:
        """Whether the client has a robot, or has sent a request a moment ago."""
        return self.has_robot() or self._loop.time() - self._requested_at_s < NEWCOMER_AGE_S

    @property
    def router_fd(self) -> int:
        """Descriptor of the socket to the ROUTER."""
        return self._sockets[1].fileno()

    @property
    def is_client_blocked(self) -> bool:
        """Whether bytes wait for the client to read."""
        return self._downstream.is_blocked

    def end(self) -> None:
        """Close both sockets; reset the connection of a client that reads nothing."""
        if self.is_client_blocked:
            # Otherwise the kernel would keep megabytes for minutes, and the client notice no end.
            no_linger = struct.pack("ii", 1, 0)
            self._sockets[0].setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, no_linger)
        # Callbacks first: the number of a closed descriptor may be reused at once.
        self._upstream.close()
        self._downstream.close()
        for end in self._sockets:
            end.close()
        self._on_close(self)

    def _inspect(self, data: bytes) -> tuple[bytes, float]:
        """Count the messages of a read; the bytes for ZeroMQ, and the time until the next read."""
        num_messages, num_parts = self._counter.num_messages, self._counter.num_parts
        # A part beyond the limit must not reach libzmq.
        self._counter.feed(data)
        num_messages = self._counter.num_messages - num_messages
        if num_messages:
            self._requested_at_s = self._loop.time()
        # A client that waits for each reply occupies the loop with one request at any time.
        self.is_dialogue = self._has_replied and num_messages <= 1
        self._has_replied = False
        self.account.charge(
            _READ_COST_S
            + _MESSAGE_COST_S * num_messages
            + _PART_COST_S * (self._counter.num_parts - num_parts),
            is_dialogue=self.is_dialogue,
        )
        return self._identity_filter.feed(data), self.account.remaining_wait_s

    def _note_reply(self, data: bytes) -> tuple[bytes, float]:
        """Pass all bytes of the ROUTER, which is ours, at once."""
        self._has_replied = True
        self._reply_counter.feed(data)
        return data, 0.0

    def _close_on_error(self, reason: Exception | None) -> None:
        # Only violations are logged here; StreamServer logs clients that disconnect.
        if isinstance(reason, RemoteProtocolError):
            log.info("stream connection of %s ended: %s", self.address, reason)
        self.end()


class Relay:
    """Bytes from a source to a sink; reads nothing more until the sink has accepted all."""

    def __init__(
        self,
        source: socket.socket,
        sink: socket.socket,
        *,
        read_bytes: int,
        inspect: _InspectBytes,
        on_end: _EndCallback,
    ) -> None:
        """Begin to relay.

        Args:
            source: Non-blocking socket to read.
            sink: Non-blocking socket to write.
            read_bytes: Largest read.
            inspect: Inspects, and may change, the bytes of each read.
            on_end: Called with the reason when the source or the sink has ended.
        """
        self._loop = asyncio.get_running_loop()
        self._source = source
        self._sink = sink
        self._read_bytes = read_bytes
        self._inspect = inspect
        self._on_end = on_end
        self._pending: list[memoryview] = []
        self._pause: asyncio.TimerHandle | None = None
        self._is_reading = self._is_writing = False
        self._update_callbacks()

    @property
    def is_blocked(self) -> bool:
        """Whether bytes wait for the sink; the end of the source is not noticed meanwhile."""
        return bool(self._pending)

    def close(self) -> None:
        """End all callbacks; to be called before the sockets are closed."""
        if self._pause is not None:
            self._pause.cancel()
        self._loop.remove_reader(self._source)
        self._loop.remove_writer(self._sink)
        # Not when the collector finds the cycle of connection and relays: up to a frame each.
        self._pending.clear()

    def _receive(self) -> None:
        try:
            received = self._source.recv(self._read_bytes)
            data, wait_s = self._inspect(received)
        except BlockingIOError:
            return
        except (OSError, RemoteProtocolError) as error:
            self._on_end(error)
            return
        if not received:
            self._on_end(None)
            return
        self._pending = [memoryview(data)] if data else []
        if wait_s > 0.0:
            self._pause = self._loop.call_later(wait_s, self._end_pause)
        self._send_pending()

    def insert(self, buffers: Sequence[Payload]) -> None:
        """Send other bytes to the sink, before all that the source has not sent yet."""
        assert not self._pending, "bytes of the source would be torn"
        self._pending = [memoryview(buffer) for buffer in buffers]
        self._send_pending()

    def _send_pending(self) -> None:
        try:
            num_sent = self._sink.sendmsg(self._pending) if self._pending else 0
        except BlockingIOError:
            num_sent = 0
        except OSError as error:
            self._on_end(error)
            return
        while self._pending and num_sent >= len(self._pending[0]):
            num_sent -= len(self._pending.pop(0))
        if num_sent:
            self._pending[0] = self._pending[0][num_sent:]
        self._update_callbacks()

    def _end_pause(self) -> None:
        self._pause = None
        self._update_callbacks()

    def _update_callbacks(self) -> None:
        """Wait for the sink while bytes are pending, else for an unpaused source."""
        # Backpressure: while the source is not read, TCP stops the sender.
        writes = bool(self._pending)
        reads = not writes and self._pause is None
        if reads != self._is_reading:
            self._is_reading = reads
            if reads:
                self._loop.add_reader(self._source, self._receive)
            else:
                self._loop.remove_reader(self._source)
        if writes != self._is_writing:
            self._is_writing = writes
            if writes:
                self._loop.add_writer(self._sink, self._send_pending)
            else:
                self._loop.remove_writer(self._sink)


class ZmtpPartCounter:
    """Counter of the parts in one connection's messages, fed with bytes."""

    def __init__(self, max_parts: int = MAX_PARTS) -> None:
        self._max_parts = max_parts
        # Of the greeting or of a frame, as far as received.
        self._head = bytearray()
        self._head_bytes = _GREETING_BYTES
        self._parse_head = self._read_greeting
        self._remaining_body_bytes = 0
        self._num_parts_of_message = 0  # of the one that has not ended
        self._is_last_part = False  # the frame whose body has not ended
        self.num_messages = 0
        """Complete messages so far."""
        self.num_parts = 0
        """Parts and commands so far."""

    @property
    def is_between_messages(self) -> bool:
        """Whether all bytes so far are whole messages and commands."""
        return not (self._head or self._remaining_body_bytes or self._num_parts_of_message)

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
        if flags & _LONG and self._head_bytes == _SHORT_HEAD_BYTES:
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
        """Count a part. A command may stand between two parts, and ends no message."""
        self.num_parts += 1
        if flags & _COMMAND:
            if flags & _MORE:
                raise RemoteProtocolError("a ZMTP command with more parts to follow")
            return
        if not flags & _MORE:
            self._num_parts_of_message = 0
            self._is_last_part = True
            return
        self._num_parts_of_message += 1
        if self._num_parts_of_message == self._max_parts:
            raise RemoteProtocolError(f"a message of more than {self._max_parts} parts")


class IdentityFilter:
    """The bytes of one connection with the identity made a property that nothing reads."""

    def __init__(self) -> None:
        self._greeting_bytes_left = _GREETING_BYTES
        self._ready = bytearray()
        self._is_done = False

    def feed(self, data: bytes) -> bytes:
        """Bytes to pass on; an incomplete READY is held back.

        Raises:
            RemoteProtocolError: READY is longer than any of a DEALER.
        """
        if self._is_done:
            return data
        # Passed at once: ZeroMQ waits for a part of its peer's greeting in the middle of sending
        # its own.
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


def _make_frames(parts: Sequence[Payload]) -> list[Payload]:
    """Frames of a message: a head and a body of each part."""
    frames: list[Payload] = []
    for index, part in enumerate(parts):
        more = _MORE if index + 1 < len(parts) else 0
        is_long = len(part) > 0xFF
        length = len(part).to_bytes(8 if is_long else 1, "big")
        frames += [bytes((more | (_LONG if is_long else 0),)) + length, part]
    return frames


def _frame_end(data: bytes | bytearray) -> int:
    """Length of the frame that the bytes begin with, head included; 0 for an incomplete head."""
    head_bytes = _LONG_HEAD_BYTES if data and data[0] & _LONG else _SHORT_HEAD_BYTES
    if len(data) < head_bytes:
        return 0
    return head_bytes + int.from_bytes(data[1:head_bytes], "big")


def _replace_identity(frame: bytes) -> bytes:
    """The first frame with the identity under another name, if READY has one."""
    position = (_LONG_HEAD_BYTES if frame[0] & _LONG else _SHORT_HEAD_BYTES) + len(_READY)
    if not frame[0] & _COMMAND or frame[position - len(_READY) : position] != _READY:
        return frame  # libzmq ends this connection
    while position < len(frame):
        name_begin, name_end = position + 1, position + 1 + frame[position]
        # Names are compared without case.
        if frame[name_begin:name_end].lower() == _IDENTITY:
            frame = frame[:name_begin] + _REPLACEMENT + frame[name_end:]
        value_bytes = int.from_bytes(frame[name_end : name_end + 4], "big")
        position = name_end + 4 + value_bytes
    return frame
