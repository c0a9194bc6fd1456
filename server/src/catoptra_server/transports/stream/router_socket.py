"""The ROUTER socket of the stream on the asyncio loop: the only module of the server with zmq.

The socket never blocks and never queues without limit: a message for a full peer is not sent, and
messages from a fast peer wait in the TCP connection of that peer. ZeroMQ alone does not give the
second guarantee for a message that never ends, so a connection guard owns the public port, with the
ROUTER behind the guard.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress

import zmq
from zmq.utils.monitor import parse_monitor_message

from catoptra_protocol.stream.codec import MAX_REQUEST_BYTES
from catoptra_server.transports.listener import BACKLOG
from catoptra_server.transports.stream.connection_guard import ConnectionGuard
from catoptra_server.transports.stream.outbox import SendResult
from catoptra_server.transports.stream.private_folder import SOCKET_NAME, create_private_folder
from catoptra_server.transports.tcp_server import ConnectionLimits

# Messages of one peer in the queue of ZeroMQ, besides its TCP connection; replies that find no room
# wait in the peer's outbox. No more than keeps the connection busy: each may be a frame of 50 MB.
_SEND_HIGH_WATER_MARK = 2
# Messages of one peer that wait for the server; the rest stays in TCP, which blocks the peer.
_RECEIVE_HIGH_WATER_MARK = 16
# Messages per turn of the loop, so that a busy peer does not starve the others.
_MAX_MESSAGES_PER_READ = 32
_MONITOR_ENDPOINT = "inproc://monitor"

MessageHandler = Callable[[bytes, list[bytes]], None]


class RouterSocket:
    """A bound ROUTER behind a connection guard."""

    def __init__(
        self,
        listener: socket.socket,
        *,
        limits: ConnectionLimits,
        on_message: MessageHandler,
        on_disconnect: Callable[[bytes], None],
    ) -> None:
        """Accept connections.

        Args:
            listener: Listening socket of the public port; closed with this one.
            limits: Limits of the connections.
            on_message: Called with the identity of a peer and the parts of its message.
            on_disconnect: Called with the identity of a peer whose connection has ended, before
                any message of another connection with the same identity.

        Raises:
            OSError: The private socket of the ROUTER is not available.
        """
        self._loop = asyncio.get_running_loop()
        self._on_message = on_message
        self._on_disconnect = on_disconnect
        with ExitStack() as resources:
            resources.enter_context(listener)
            self.port: int = listener.getsockname()[1]
            path = str(resources.enter_context(create_private_folder()) / SOCKET_NAME)
            context = zmq.Context(io_threads=1)
            resources.callback(context.destroy, linger=0)
            self._monitor = context.socket(zmq.PAIR)
            self._socket = _bind_router(context, f"ipc://{path}", monitor=self._monitor)
            resources.callback(ConnectionGuard(listener, path, limits=limits).close)
            self._release = resources.pop_all().close
        # File descriptors of the connections: open ones, and those of peers with a message.
        self._open_connections: set[int] = set()
        self._connections: dict[bytes, int] = {}
        self._identities: dict[int, bytes] = {}
        self._is_closed = False
        self._scheduled_read: asyncio.Handle | None = None
        self._loop.add_reader(self._socket.FD, self._read)
        self._loop.add_reader(self._monitor.FD, self._read_monitor)
        self._schedule_read()

    def send(self, peer: bytes, parts: Sequence[bytes | memoryview]) -> SendResult:
        """Send a message at once, or not at all; a closed socket has no connected peers."""
        if self._is_closed:
            return SendResult.DISCONNECTED
        result = self._try_send(peer, parts)
        if result is SendResult.QUEUE_FULL:
            # ZeroMQ notices only now and then that peers have read, except on this query.
            self._socket.get(zmq.EVENTS)
            result = self._try_send(peer, parts)
        # The file descriptor signals once, and either call may consume the signal of a message.
        self._schedule_read()
        return result

    def _try_send(self, peer: bytes, parts: Sequence[bytes | memoryview]) -> SendResult:
        try:
            self._socket.send_multipart([peer, *parts], flags=zmq.NOBLOCK)
        except zmq.Again:
            return SendResult.QUEUE_FULL
        except zmq.ZMQError as error:
            if error.errno != errno.EHOSTUNREACH:
                raise
            self._forget(peer)
            return SendResult.DISCONNECTED
        return SendResult.SENT

    def disconnect(self, peer: bytes) -> None:
        """End the connection of a peer; unsent messages are dropped."""
        connection = self._connections.get(peer)
        if connection is None or self._is_closed:
            return
        # ZeroMQ has no call for this, so the connection is shut down below it. The descriptor is
        # duplicated first: if it is not reported as ended after that, it was the peer's until then,
        # and the duplicate stays so.
        with ExitStack() as stack, suppress(OSError):
            end = stack.enter_context(socket.socket(fileno=os.dup(connection)))
            self._read_monitor()
            if self._connections.get(peer) == connection:
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Release the port and drop all unsent messages."""
        self._is_closed = True
        self._loop.remove_reader(self._socket.FD)
        self._loop.remove_reader(self._monitor.FD)
        if self._scheduled_read is not None:
            self._scheduled_read.cancel()
        self._release()

    def _schedule_read(self) -> None:
        if self._scheduled_read is None:
            self._scheduled_read = self._loop.call_soon(self._run_scheduled_read)

    def _run_scheduled_read(self) -> None:
        self._scheduled_read = None
        self._read()

    def _read(self) -> None:
        for _ in range(_MAX_MESSAGES_PER_READ):
            try:
                # Without copies: only zmq's own message objects know the descriptor of their
                # connection.
                head, *parts = self._socket.recv_multipart(flags=zmq.NOBLOCK, copy=False)
            except zmq.Again:
                return
            # Ends that were reported before this message are known before it is handled: a
            # newcomer must not pass for the departed peer whose identity or descriptor it has.
            self._read_monitor()
            if self._register(head.bytes, int(head.get(zmq.SRCFD))):
                self._on_message(head.bytes, [part.bytes for part in parts])
        self._schedule_read()

    def _register(self, peer: bytes, connection: int) -> bool:
        """Record the connection of a peer; False for one that has ended, whose rest is dropped."""
        if connection not in self._open_connections:
            return False
        if self._connections.get(peer, connection) != connection:
            self._end(peer)
        self._connections[peer] = connection
        self._identities[connection] = peer
        return True

    def _read_monitor(self) -> None:
        """Read the beginnings and ends of connections, all that are reported."""
        while True:
            try:
                event = parse_monitor_message(self._monitor.recv_multipart(flags=zmq.NOBLOCK))
            except zmq.Again:
                return
            connection = event["value"]
            if event["event"] == zmq.EVENT_ACCEPTED:
                self._open_connections.add(connection)
                continue
            self._open_connections.discard(connection)
            peer = self._identities.get(connection)
            if peer is not None:
                self._end(peer)

    def _end(self, peer: bytes) -> None:
        self._forget(peer)
        self._on_disconnect(peer)

    def _forget(self, peer: bytes) -> None:
        connection = self._connections.pop(peer, None)
        if connection is not None:
            self._identities.pop(connection, None)


def _bind_router(
    context: zmq.Context[zmq.Socket[bytes]], endpoint: str, *, monitor: zmq.Socket[bytes]
) -> zmq.Socket[bytes]:
    """Bind a ROUTER, with its limits and a monitor of disconnections.

    Args:
        context: ZeroMQ context.
        endpoint: Private endpoint.
        monitor: PAIR socket that receives an event for every connection that begins or ends.

    Raises:
        OSError: The endpoint is not available.
    """
    router = context.socket(zmq.ROUTER)
    # All options before bind: later ones do not apply to connections of the endpoint.
    router.set(zmq.BACKLOG, BACKLOG)
    router.set(zmq.SNDHWM, _SEND_HIGH_WATER_MARK)
    router.set(zmq.RCVHWM, _RECEIVE_HIGH_WATER_MARK)
    # A longer part ends its connection as soon as its length is read, before memory is
    # allocated.
    router.set(zmq.MAXMSGSIZE, MAX_REQUEST_BYTES)
    # A send to a disconnected or full peer fails, in place of a silent drop.
    router.set(zmq.ROUTER_MANDATORY, 1)
    # No HEARTBEAT_IVL: libzmq 4.3.5 aborts the process if its timer meets a connection that ended
    # while its queue was full. The guard's TCP options detect hosts that vanish.
    router.set(zmq.LINGER, 0)
    router.monitor(_MONITOR_ENDPOINT, zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
    # Without a limit: ZeroMQ's thread must never wait for the loop to read the monitor.
    monitor.set(zmq.RCVHWM, 0)
    monitor.connect(_MONITOR_ENDPOINT)
    try:
        router.bind(endpoint)
    except zmq.ZMQError as error:
        reason = f"{endpoint}: {error.strerror}: set TMPDIR to a short, writable path"
        raise OSError(error.errno, reason) from error
    return router
