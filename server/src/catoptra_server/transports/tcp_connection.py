"""One accepted TCP connection: reads of bounded size, and notice of a peer that has left."""

from __future__ import annotations

import asyncio
import fcntl
import re
import socket
import struct
import termios
import time
from collections import deque
from collections.abc import Callable
from typing import cast

# A chunk of input: a turn of the loop handles at most some 100 commands.
READ_BYTES = 4 * 1024
_MAX_CHUNKS_AHEAD = 2
# States in the first byte of Linux's TCP_INFO: open, and after the peer's FIN.
_ESTABLISHED = 1
_CLOSE_WAIT = 8
_HTTP_REQUEST = re.compile(rb"[A-Za-z-]+ .*HTTP/[0-9.]+ *", re.DOTALL)
# Bytes kept of either end of a first line: a method, a version.
_LINE_END_BYTES = 32


class HttpRequestError(ConnectionError):
    """The first line of a connection is an HTTP request.

    A web page makes a browser send one to any port of its user, and lines of the body would be
    commands. Redis closes such connections likewise.
    """


class TcpConnection(asyncio.BufferedProtocol):
    """Both directions of a connection.

    At most two chunks are read ahead: the peer's end is noticed while its last input is handled,
    and TCP holds back a peer that sends faster than its input is handled. The first one does not
    pause the socket: a dialogue takes two calls of the system less for each request.
    """

    def __init__(self, address: str, *, on_lost: Callable[[TcpConnection], None]) -> None:
        """Create the protocol of a socket that is about to be connected to a transport.

        Args:
            address: Address of the peer, for logs.
            on_lost: Called once when the connection ends, for whatever reason.
        """
        self.address = address
        self.accepted_at_s = self.received_at_s = time.monotonic()
        """Times of the connection and of the last input."""
        self.peer_ended_at_s: float | None = None
        """Time since which the peer sends nothing more, though it may still read; None if open."""
        self.has_handshake = False
        """Whether the peer has sent something valid."""
        self.may_idle = False
        """Whether the peer may be silent for longer than the idle time-out."""
        self._on_lost = on_lost
        # None until asyncio has connected the socket, a turn of the loop after it was accepted.
        self._transport: asyncio.Transport | None = None
        self._buffer = bytearray(READ_BYTES)
        self._ahead: deque[bytes] = deque()
        # Both ends of the first line so far; None behind it.
        self._first_line: bytes | None = b""
        self._is_lost = False
        self._has_read_all = False
        self._arrival: asyncio.Future[None] | None = None
        self._can_write = asyncio.Event()
        self._can_write.set()

    @property
    def is_connected(self) -> bool:
        """Whether there is, or has been, a transport that owns the socket."""
        return self._transport is not None

    async def read(self) -> bytes:
        """Next input, at most READ_BYTES; empty once the peer sends nothing more.

        Raises:
            HttpRequestError: The first line is complete with this input, and an HTTP request.
        """
        # Not by `peer_ended_at_s`, which may be known while input still waits in the kernel.
        while not self._ahead and not self._has_read_all:
            self._arrival = asyncio.get_running_loop().create_future()
            await self._arrival
        if not self._ahead:
            return b""
        if self._is_paused and self._transport is not None:
            self._transport.resume_reading()
        data = self._ahead.popleft()
        if self._first_line is not None:
            self._check_first_line(self._first_line + data)
        return data

    def _check_first_line(self, data: bytes) -> None:
        """Raise HttpRequestError where these bytes end a first line that is an HTTP request."""
        line, end, _ = data.replace(b"\r", b"\n").partition(b"\n")
        # The peer chooses the length of a path: without the middle any line is short.
        self._first_line = (
            None if end else line[:_LINE_END_BYTES] + line[_LINE_END_BYTES:][-_LINE_END_BYTES:]
        )
        if end and _HTTP_REQUEST.fullmatch(line):
            raise HttpRequestError("an HTTP request instead of the protocol of this port")

    def _end_wait(self) -> None:
        """Resume a coroutine that waits for input."""
        arrival, self._arrival = self._arrival, None
        if arrival is not None and not arrival.done():
            arrival.set_result(None)

    @property
    def _is_paused(self) -> bool:
        """Whether the socket is not read."""
        return len(self._ahead) >= _MAX_CHUNKS_AHEAD

    @property
    def has_more_input(self) -> bool:
        """Whether input is waiting that has not been read."""
        if self._ahead or self._transport is None or self.is_closing:
            return bool(self._ahead)
        waiting = bytearray(struct.calcsize("i"))
        fcntl.ioctl(self._transport.get_extra_info("socket").fileno(), termios.FIONREAD, waiting)
        return any(waiting)

    def write(self, data: bytes | memoryview) -> None:
        """Send bytes, or queue them."""
        if self._transport is not None and not self._is_lost:
            # A view: asyncio cuts off the part that is sent at once.
            self._transport.write(memoryview(data))

    async def drain(self) -> None:
        """Wait until most of the queued bytes are sent."""
        await self._can_write.wait()

    @property
    def num_unsent_bytes(self) -> int:
        """Queued bytes."""
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    @property
    def is_closing(self) -> bool:
        """Whether no more bytes are sent."""
        return self._is_lost or self._transport is None or self._transport.is_closing()

    def close(self) -> None:
        """Close the connection after the queued bytes are sent."""
        if self._transport is not None:
            self._transport.close()

    def abort(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def check_peer(self) -> None:
        """Notice the end of a peer whose further input waits in the kernel."""
        # A socket that is not read does not report its end.
        if not self._is_paused or self.is_closing:
            return
        state = self._tcp_state()
        if state == _CLOSE_WAIT:
            self.peer_ended_at_s = self.peer_ended_at_s or time.monotonic()
        elif state != _ESTABLISHED:
            self.abort()

    def _tcp_state(self) -> int:
        if not hasattr(socket, "TCP_INFO"):
            return _ESTABLISHED  # not Linux: an end is noticed once the input before it is handled
        assert self._transport is not None, "input was read from it"
        end = self._transport.get_extra_info("socket")
        return int(end.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0])

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin; called by asyncio."""
        self._transport = cast(asyncio.Transport, transport)

    def get_buffer(self, sizehint: int) -> bytearray:
        """Buffer of the next read; called by asyncio."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Store input; called by asyncio."""
        assert self._transport is not None, "asyncio reads from it"
        self._ahead.append(bytes(memoryview(self._buffer)[:nbytes]))
        if self._is_paused:
            self._transport.pause_reading()
        self.received_at_s = time.monotonic()
        self._end_wait()

    def eof_received(self) -> bool:
        """Record the end of the peer's input; called by asyncio."""
        self.peer_ended_at_s = self.peer_ended_at_s or time.monotonic()
        self._has_read_all = True
        self._end_wait()
        return True  # keep the other direction open: replies are still due

    def pause_writing(self) -> None:
        """Let `drain` wait; called by asyncio."""
        self._can_write.clear()

    def resume_writing(self) -> None:
        """End the waits of `drain`; called by asyncio."""
        self._can_write.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """Record the end of the connection; called by asyncio."""
        self._is_lost = self._has_read_all = True
        # First: a handler that this cancels is not to go on as after the end of the input.
        self._on_lost(self)
        self._end_wait()
        self._can_write.set()
