"""A TCP server with limits that ends with certainty, whatever its peers do.

Connections are limited in number; a peer that is silent for too long is disconnected; a peer that
has left is noticed while its input is still being handled.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.faults import log_fault
from catoptra_server.transports.listener import AcceptLoop, create_listener
from catoptra_server.transports.loop_share import LoopShare
from catoptra_server.transports.tcp_connection import HttpRequestError, TcpConnection

ConnectionHandler = Callable[[TcpConnection], Awaitable[None]]

log = logging.getLogger(__name__)

# Time for the last bytes to a peer that reads slowly, or not at all.
_LINGER_S = 10.0
_CHECK_INTERVAL_S = 0.25


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of the connections to one port."""

    max_connections: int = 64
    """Concurrent connections, as in UDK. At the limit the oldest one without a handshake, or else
    whose peer has left, is closed for a newcomer; without such a one the newcomer is rejected."""
    handshake_timeout_s: float = 300.0
    """Time for the first valid input; 0 = no limit."""
    idle_timeout_s: float = 600.0
    """Silence of a peer, unless its handler allows more; 0 = no limit."""
    loop_share: LoopShare = field(default_factory=LoopShare)
    """Time of the event loop for the peers' input; one for all ports of a server."""


class TcpServer:
    """A listening port and its connections."""

    def __init__(
        self,
        listener: socket.socket,
        handler: ConnectionHandler,
        *,
        name: str,
        limits: ConnectionLimits,
        end_grace_s: float,
    ) -> None:
        """Begin to accept connections; see `serve_tcp`."""
        self._loop = asyncio.get_running_loop()
        self._handler = handler
        self._name = name
        self._limits = limits
        self._end_grace_s = end_grace_s
        # In the order of acceptance. A closed connection counts until its last bytes are sent.
        self._connections: dict[TcpConnection, asyncio.Task[None]] = {}
        self._accept_loop = AcceptLoop(listener, self._accept, name=name)
        self._check = self._loop.call_later(_CHECK_INTERVAL_S, self._check_connections)

    @property
    def port(self) -> int:
        """TCP port on which the server listens."""
        return self._accept_loop.port

    @property
    def num_connections(self) -> int:
        """Number of open connections."""
        return len(self._connections)

    async def close(self) -> None:
        """Release the port and end every connection."""
        self._accept_loop.close()
        self._check.cancel()
        ended = dict(self._connections)
        for task in ended.values():
            task.cancel()
        await asyncio.gather(*ended.values(), return_exceptions=True)
        for connection in ended:
            connection.abort()

    def _accept(self, accepted: socket.socket, address: str) -> None:
        if len(self._connections) >= self._limits.max_connections and not self._make_room():
            raise ConnectionRefusedError(
                f"the limit of {self._limits.max_connections} connections is reached"
            )
        connection = TcpConnection(address, on_lost=self._remove)
        task = self._loop.create_task(self._run(connection, accepted))
        # A callback, not the coroutine's own end: a task that is cancelled at once never runs.
        task.add_done_callback(lambda _: self._close(connection, accepted))
        self._connections[connection] = task

    def _make_room(self) -> bool:
        """Close a connection that needs its place least; False if there is none."""
        silent = (one for one in self._connections if not one.has_handshake)
        ended = (one for one in self._connections if one.peer_ended_at_s is not None)
        oldest = next(itertools.chain(silent, ended), None)
        if oldest is None:
            return False
        log.info("%s closed for a newcomer: it has left or sent nothing valid", oldest.address)
        self._end(oldest)
        # At once, not when asyncio reports the end: the newcomer takes its place.
        self._connections.pop(oldest, None)
        return True

    async def _run(self, connection: TcpConnection, accepted: socket.socket) -> None:
        try:
            await self._loop.connect_accepted_socket(lambda: connection, accepted)
            await self._handler(connection)
        except HttpRequestError as error:
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
        """Close the connection of a task that has ended, after its last bytes are sent."""
        if not connection.is_connected:
            accepted.close()  # no transport owns the socket
            self._connections.pop(connection, None)
            return
        connection.close()
        if connection.num_unsent_bytes:
            self._loop.call_later(_LINGER_S, connection.abort)

    def _remove(self, connection: TcpConnection) -> None:
        task = self._connections.pop(connection, None)
        if task is not None:
            task.cancel()

    def _end(self, connection: TcpConnection) -> None:
        self._connections[connection].cancel()
        connection.abort()

    def _check_connections(self) -> None:
        self._check = self._loop.call_later(_CHECK_INTERVAL_S, self._check_connections)
        now_s = time.monotonic()
        for connection, task in list(self._connections.items()):
            connection.check_peer()
            ended_at_s = connection.peer_ended_at_s
            if ended_at_s is not None and now_s - ended_at_s > self._end_grace_s:
                task.cancel()  # its bytes so far are sent
            elif reason := self._overdue(connection, now_s):
                log.info("%s disconnected: %s", connection.address, reason)
                self._end(connection)

    def _overdue(self, connection: TcpConnection, now_s: float) -> str:
        """Reason to end a connection that is silent for too long; empty for none."""
        limits = self._limits
        if not connection.has_handshake:
            limit_s = limits.handshake_timeout_s
            is_overdue = 0.0 < limit_s < now_s - connection.accepted_at_s
            return f"nothing valid within {limit_s:g} s" if is_overdue else ""
        limit_s = limits.idle_timeout_s
        is_overdue = 0.0 < limit_s < now_s - connection.received_at_s and not connection.may_idle
        return f"silent for {limit_s:g} s" if is_overdue else ""


@asynccontextmanager
async def serve_tcp(
    host: str,
    port: int,
    handler: ConnectionHandler,
    *,
    name: str,
    limits: ConnectionLimits,
    end_grace_s: float,
) -> AsyncIterator[TcpServer]:
    """Run a handler for every connection until the block ends.

    A connection ends when its handler returns, the connection breaks, or a time-out passes; bytes
    written before a return are still sent.

    Args:
        host: Host name or address of the interface.
        port: TCP port; 0 = a free one.
        handler: Coroutine of one connection; cancelled when the connection ends.
        name: Name of the port in logs and errors.
        limits: Number of connections, and time-outs.
        end_grace_s: Time of the handler after the peer's last input.

    Raises:
        OSError: The port is not available; names it.
    """
    listener = create_listener(host, port, name=name)
    server = TcpServer(listener, handler, name=name, limits=limits, end_grace_s=end_grace_s)
    try:
        yield server
    finally:
        await server.close()
