"""The ROUTER socket of the stream on the asyncio loop: the only module of the server with zmq.

The socket never blocks and never queues without limit: a message for a full peer is not sent, and
messages from a fast peer wait in the TCP connection of that peer. ZeroMQ alone does not give the
second guarantee for a message that never ends, so a connection guard owns the public port, with the
ROUTER behind the guard.
"""

from __future__ import annotations

import asyncio
import errno
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from enum import Enum, auto
from tempfile import TemporaryDirectory

import zmq
from zmq.utils.monitor import parse_monitor_message

from catoptra_server.transports.stream.connection_guard import (
    MAX_CONNECTIONS,
    ConnectionGuard,
    create_listener,
)

# Messages that wait for one peer, besides its TCP connection. A peer with one pending request has
# at most one frame, one reply and some heartbeats there.
_SEND_HIGH_WATER_MARK = 8
# Messages of one peer that wait for the server; the rest stays in TCP, which blocks the peer.
_RECEIVE_HIGH_WATER_MARK = 16
# A longer part ends its connection as soon as its length is read, before memory is allocated.
_MAX_PART_BYTES = 8 * 1024
# Messages per turn of the loop, so that a busy peer does not starve the others.
_MAX_MESSAGES_PER_READ = 32
# A peer whose host vanished without closing is disconnected after the timeout; a live process
# replies from ZeroMQ's own thread, even when busy.
_PING_INTERVAL_MS = 2000
_PING_TIMEOUT_MS = 6000
_MONITOR_ENDPOINT = "inproc://monitor"

MessageHandler = Callable[[bytes, list[bytes]], None]


class SendResult(Enum):
    """Outcome of a send."""

    SENT = auto()
    QUEUE_FULL = auto()
    DISCONNECTED = auto()


class RouterSocket:
    """A bound ROUTER behind a connection guard."""

    def __init__(self, host: str, port: int, on_message: MessageHandler) -> None:
        """Bind the port.

        Args:
            host: Host name or address of the interface.
            port: TCP port; 0 = a free one, see `port`.
            on_message: Called with the identity of a peer and the parts of its message.

        Raises:
            OSError: The port, or the private socket of the ROUTER, is not available.
        """
        self._loop = asyncio.get_running_loop()
        self._on_message = on_message
        with ExitStack() as resources:
            listener = resources.enter_context(create_listener(host, port))
            self.port: int = listener.getsockname()[1]
            # A directory of mode 0700: no other user can bypass the guard.
            path = resources.enter_context(TemporaryDirectory(prefix="catoptra-")) + "/stream"
            context = zmq.Context(io_threads=1)
            resources.callback(context.destroy, linger=0)
            self._monitor = context.socket(zmq.PAIR)
            self._socket = _bind_router(context, f"ipc://{path}", monitor=self._monitor)
            resources.callback(ConnectionGuard(listener, path).close)
            self._release = resources.pop_all().close
        self._connections: dict[bytes, int] = {}
        self._is_closed = False
        self._scheduled_read: asyncio.Handle | None = None
        self._loop.add_reader(self._socket.FD, self._read)
        self._schedule_read()

    def send(self, peer: bytes, parts: Sequence[bytes]) -> SendResult:
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

    def _try_send(self, peer: bytes, parts: Sequence[bytes]) -> SendResult:
        try:
            self._socket.send_multipart([peer, *parts], flags=zmq.NOBLOCK)
        except zmq.Again:
            return SendResult.QUEUE_FULL
        except zmq.ZMQError as error:
            if error.errno != errno.EHOSTUNREACH:
                raise
            self._connections.pop(peer, None)
            return SendResult.DISCONNECTED
        return SendResult.SENT

    def poll_disconnects(self) -> set[bytes]:
        """Peers that may have disconnected since the last call.

        The monitor reports file descriptors, which another connection may use by now: a send to the
        peer decides.
        """
        ended: set[int] = set()
        while self._monitor.poll(0):
            ended.add(parse_monitor_message(self._monitor.recv_multipart())["value"])
        return {peer for peer, connection in self._connections.items() if connection in ended}

    def close(self) -> None:
        """Release the port and drop all unsent messages."""
        self._is_closed = True
        self._loop.remove_reader(self._socket.FD)
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
            self._connections[head.bytes] = int(head.get(zmq.SRCFD))
            self._on_message(head.bytes, [part.bytes for part in parts])
        self._schedule_read()


def _bind_router(
    context: zmq.Context[zmq.Socket[bytes]], endpoint: str, *, monitor: zmq.Socket[bytes]
) -> zmq.Socket[bytes]:
    """Bind a ROUTER, with its limits and a monitor of disconnections.

    Args:
        context: ZeroMQ context.
        endpoint: Private endpoint.
        monitor: PAIR socket that receives an event for every connection that ends.

    Raises:
        OSError: The endpoint is not available.
    """
    router = context.socket(zmq.ROUTER)
    # All options before bind: later ones do not apply to connections of the endpoint.
    router.set(zmq.BACKLOG, MAX_CONNECTIONS)
    router.set(zmq.SNDHWM, _SEND_HIGH_WATER_MARK)
    router.set(zmq.RCVHWM, _RECEIVE_HIGH_WATER_MARK)
    router.set(zmq.MAXMSGSIZE, _MAX_PART_BYTES)
    # A send to a disconnected or full peer fails, in place of a silent drop.
    router.set(zmq.ROUTER_MANDATORY, 1)
    router.set(zmq.HEARTBEAT_IVL, _PING_INTERVAL_MS)
    router.set(zmq.HEARTBEAT_TIMEOUT, _PING_TIMEOUT_MS)
    router.set(zmq.LINGER, 0)
    router.monitor(_MONITOR_ENDPOINT, zmq.EVENT_DISCONNECTED)
    # Without a limit: ZeroMQ's thread must never wait for the loop to read the monitor.
    monitor.set(zmq.RCVHWM, 0)
    monitor.connect(_MONITOR_ENDPOINT)
    try:
        router.bind(endpoint)
    except zmq.ZMQError as error:
        reason = f"{endpoint}: {error.strerror}: set TMPDIR to a short, writable path"
        raise OSError(error.errno, reason) from error
    return router
