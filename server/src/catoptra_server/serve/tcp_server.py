"""A TCP server with limits that ends with certainty, whatever the peers do.

Connections are limited in number and read in chunks of bounded size. A peer that is silent for too
long is disconnected; a peer that has left is noticed while earlier input is still being handled.
The protocol of a port is its handler, `tcp_control` or `tcp_image`.

A first line that is an HTTP request ends the connection: a web page makes a browser send one to any
port of its user, and lines of the body would be commands. Redis closes such connections likewise.
"""

from __future__ import annotations

import asyncio
import fcntl
import logging
import math
import re
import socket
import struct
import termios
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import cast

from catoptra_server.runtime.faults import log_fault
from catoptra_server.serve.limits import NEWCOMER_AGE_S
from catoptra_server.serve.port import ConnectionLimits, Port, create_listener

log = logging.getLogger(__name__)
# A chunk of input: a turn of the loop handles at most some 100 commands.
_READ_BYTES = 4 * 1024
_MAX_CHUNKS_AHEAD = 2
# States in the first byte of Linux's TCP_INFO: open, and after the peer's FIN.
_ESTABLISHED = 1
_CLOSE_WAIT = 8
_HTTP_REQUEST = re.compile(rb"[A-Za-z-]+ .*HTTP/[0-9.]+ *", re.DOTALL)
# Bytes kept of either end of a first line: a method, a version.
_LINE_END_BYTES = 32
# Time for the last bytes to a peer that reads slowly, or not at all.
_LINGER_S = 10.0


class TcpConnection(asyncio.BufferedProtocol):
    """Both directions of a connection.

    At most two chunks are read ahead: the peer's end is noticed while the last input is handled,
    and TCP holds back a peer that sends too fast. The first one does not
    pause the socket: a dialogue takes two calls of the system less for each request.
    """

    def __init__(self, address: str, *, on_lost: Callable[[TcpConnection], None]) -> None:
        """Create the protocol of a socket that is about to be connected to a transport.

        Args:
            address: Address of the peer, for logs.
            on_lost: Called once when the connection ends, for whatever reason.
        """
        self.address = address
        self.opened_at_s = self.received_at_s = time.monotonic()
        """Times of the connection and of the last input, on the loop's clock."""
        self.peer_ended_at_s: float | None = None
        """Time since which the peer sends nothing more, but may read; None if open."""
        self.has_handshake = False
        """Whether the peer has sent something valid."""
        self.has_robot = False
        """Whether the peer has a robot: it may be silent for as long as it likes."""
        self.watched_at_s = -math.inf
        """Time of the last request for an image."""
        self.task: asyncio.Task[None] | None = None
        """The handler."""
        self._on_lost = on_lost
        # None until asyncio has connected the socket, a turn of the loop after it was accepted.
        self._transport: asyncio.Transport | None = None
        self._buffer = bytearray(_READ_BYTES)
        self._ahead: deque[bytes] = deque()
        # Both ends of the first line so far; None behind it.
        self._first_line: bytes | None = b""
        self._is_lost = False
        self._has_read_all = False
        self._arrival: asyncio.Future[None] | None = None
        self._can_write = asyncio.Event()
        self._can_write.set()

    @property
    def has_left(self) -> bool:
        """Whether the peer sends nothing more."""
        return self.peer_ended_at_s is not None

    @property
    def is_in_use(self) -> bool:
        """Whether the peer has a robot, or watches one."""
        return self.has_robot or time.monotonic() - self.watched_at_s < NEWCOMER_AGE_S

    @property
    def is_connected(self) -> bool:
        """Whether there is, or has been, a transport that owns the socket."""
        return self._transport is not None

    async def read(self) -> bytes:
        """Next input, at most _READ_BYTES; empty once the peer sends nothing more.

        Raises:
            _HttpRequestError: The first line is complete with this input, and an HTTP request.
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
        """Raise _HttpRequestError where these bytes end a first line that is an HTTP request."""
        line, end, _ = data.replace(b"\r", b"\n").partition(b"\n")
        # The peer chooses the length of a path: without the middle any line is short.
        self._first_line = (
            None if end else line[:_LINE_END_BYTES] + line[_LINE_END_BYTES:][-_LINE_END_BYTES:]
        )
        if end and _HTTP_REQUEST.fullmatch(line):
            raise _HttpRequestError("an HTTP request instead of the protocol of this port")

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
        """Send or queue bytes."""
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

    def end(self) -> None:
        """End handler and connection at once."""
        if self.task is not None:
            self.task.cancel()
        self.abort()

    def check_peer(self) -> None:
        """Notice the end of a peer whose further input waits in the kernel."""
        # A socket that is not read does not report the end.
        if not self._is_paused or self.is_closing:
            return
        state = self._tcp_state()
        if state == _CLOSE_WAIT:
            self.peer_ended_at_s = self.peer_ended_at_s or time.monotonic()
        elif state != _ESTABLISHED:
            self.abort()

    def _tcp_state(self) -> int:
        if not hasattr(socket, "TCP_INFO"):
            return _ESTABLISHED  # not Linux: an end is noticed once the input before is handled
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


_ConnectionHandler = Callable[[TcpConnection], Awaitable[None]]


class TcpServer:
    """A listening port and its connections."""

    def __init__(
        self,
        listener: socket.socket,
        handler: _ConnectionHandler,
        *,
        name: str,
        first_bytes: re.Pattern[bytes],
        limits: ConnectionLimits,
        end_grace_s: float,
    ) -> None:
        """Begin to accept connections; see `serve_tcp`."""
        self._loop = asyncio.get_running_loop()
        self._handler = handler
        self._limits = limits
        self._end_grace_s = end_grace_s
        # A closed connection counts until the last bytes are sent.
        self._port = Port(
            listener,
            self._open,
            name=name,
            limits=limits,
            first_bytes=first_bytes,
            check=self._check,
        )

    @property
    def port(self) -> int:
        """TCP port on which the server listens."""
        return self._port.number

    @property
    def num_connections(self) -> int:
        """Number of open connections."""
        return len(self._port)

    async def close(self) -> None:
        """Release the port and end every connection."""
        self._port.close()
        connections = [*self._port]
        tasks = [one.task for one in connections if one.task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for connection in connections:
            connection.abort()

    def _open(self, accepted: socket.socket, address: str) -> TcpConnection:
        connection = TcpConnection(address, on_lost=self._remove)
        connection.task = self._loop.create_task(self._run(connection, accepted))
        # A callback, not the coroutine's own end: a task that is cancelled at once never runs.
        connection.task.add_done_callback(lambda _: self._close(connection, accepted))
        return connection

    async def _run(self, connection: TcpConnection, accepted: socket.socket) -> None:
        try:
            await self._loop.connect_accepted_socket(lambda: connection, accepted)
            await self._handler(connection)
        except _HttpRequestError as error:
            log.warning("%s disconnected: %s", connection.address, error)
        except OSError as error:
            log.info("%s disconnected: %s", connection.address, error)
        except asyncio.CancelledError:
            # The peer has left or the server ends; Python 3.11 would log the task as failed.
            pass
        except Exception:
            # The top of a task; before Python 3.11.3 asyncio would not report the exception.
            log_fault(log, "the connection of %s failed and is closed", connection.address)

    def _close(self, connection: TcpConnection, accepted: socket.socket) -> None:
        """Close the connection of a task that has ended, after the last bytes are sent."""
        if not connection.is_connected:
            accepted.close()  # no transport owns the socket
            self._port.remove(connection)
            return
        connection.close()
        if connection.num_unsent_bytes:
            self._loop.call_later(_LINGER_S, connection.abort)

    def _remove(self, connection: TcpConnection) -> None:
        self._port.remove(connection)
        if connection.task is not None:
            connection.task.cancel()

    def _check(self, connection: TcpConnection, now_s: float) -> str:
        """Reason to end a connection that is silent for too long; empty for none."""
        connection.check_peer()
        ended_at_s, limit_s = connection.peer_ended_at_s, self._limits.idle_timeout_s
        if ended_at_s is not None and now_s - ended_at_s > self._end_grace_s:
            assert connection.task is not None, "set before the connection is in the port's list"
            connection.task.cancel()  # bytes so far are sent
        elif 0.0 < limit_s < now_s - connection.received_at_s and not connection.has_robot:
            return f"silent for {limit_s:g} s"
        return ""


@asynccontextmanager
async def serve_tcp(
    host: str,
    port: int,
    handler: _ConnectionHandler,
    *,
    name: str,
    first_bytes: re.Pattern[bytes],
    limits: ConnectionLimits,
    end_grace_s: float,
) -> AsyncIterator[TcpServer]:
    """Run a handler for every connection until the block ends.

    A connection ends when the handler returns, the connection breaks, or a time-out passes; bytes
    written before a return are still sent.

    Args:
        host: Host name or address of the interface.
        port: TCP port; 0 = a free one.
        handler: Coroutine of one connection; cancelled when the connection ends.
        name: Name of the port in logs and errors.
        first_bytes: See `Port`.
        limits: Number of connections, and time-outs.
        end_grace_s: Time of the handler after the peer's last input.

    Raises:
        OSError: The port is not available; names it.
    """
    listener = create_listener(host, port, name=name)
    server = TcpServer(
        listener,
        handler,
        name=name,
        first_bytes=first_bytes,
        limits=limits,
        end_grace_s=end_grace_s,
    )
    try:
        yield server
    finally:
        await server.close()


class _HttpRequestError(ConnectionError):
    """The first line of a connection is an HTTP request."""
