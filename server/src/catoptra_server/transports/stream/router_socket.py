"""The stream's ROUTER socket on the asyncio loop: the server's one door to ZeroMQ.

It never blocks and never queues without bound: what a peer does not take is not sent, what a peer
sends too fast waits in that peer's own TCP connection. ZeroMQ alone cannot hold the second promise
against a message that never ends, so the public port is a turnstile's, and the ROUTER sits behind.
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

# Messages that wait for one peer, beside what its TCP connection holds. A peer that keeps to one
# request a time never has more than one frame, one answer and some pulses there.
_SEND_HIGH_WATER_MARK = 8
# Messages of one peer that wait for us; the rest stays in TCP, which holds the peer back.
_RECEIVE_HIGH_WATER_MARK = 16
# A part that is announced longer ends its connection before memory is taken for it.
_MAX_PART_BYTES = 8 * 1024
# Messages read in one go, before other work of the loop has its turn.
_MAX_MESSAGES_PER_READ = 32
# A peer whose host vanished without a word is given up after this silence of its connection; a
# living process answers from ZeroMQ's own thread, however busy it is.
_PING_INTERVAL_MS = 2000
_PING_TIMEOUT_MS = 6000
_MONITOR_ENDPOINT = "inproc://ends"

MessageHandler = Callable[[bytes, list[bytes]], None]


class SendResult(Enum):
    """What became of a message."""

    SENT = auto()
    QUEUE_FULL = auto()
    DISCONNECTED = auto()


class RouterSocket:
    """A bound socket. `received` is called with a peer's identity and the parts it sent."""

    def __init__(self, host: str, port: int, on_message: MessageHandler) -> None:
        self._loop = asyncio.get_running_loop()
        self._on_message = on_message
        with ExitStack() as kept:
            listener = kept.enter_context(create_listener(host, port))
            self.port: int = listener.getsockname()[1]
            # A directory of 0700: nobody else gets round the turnstile.
            path = kept.enter_context(TemporaryDirectory(prefix="catoptra-")) + "/stream"
            context = zmq.Context(io_threads=1)
            kept.callback(context.destroy, linger=0)
            self._monitor = context.socket(zmq.PAIR)
            self._socket = _bind_router(context, f"ipc://{path}", monitor=self._monitor)
            kept.callback(ConnectionGuard(listener, path).close)
            self._release = kept.pop_all().close
        self._connections: dict[bytes, int] = {}
        self._is_closed = False
        self._scheduled_read: asyncio.Handle | None = None
        self._loop.add_reader(self._socket.FD, self._read)
        self._schedule_read()

    def send(self, peer: bytes, parts: Sequence[bytes]) -> SendResult:
        """Send a message at once, or not at all; once this is closed, nobody is there."""
        if self._is_closed:
            return SendResult.DISCONNECTED
        sent = self._try_send(peer, parts)
        if sent is SendResult.QUEUE_FULL:
            # ZeroMQ takes note of what peers have taken only now and then, unless asked what is up.
            self._socket.get(zmq.EVENTS)
            sent = self._try_send(peer, parts)
        # Both may take the one readiness that the file descriptor tells of.
        self._schedule_read()
        return sent

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
        """Return peers that may be gone: a connection ended where theirs was since the last call.

        Whether it was theirs, sending tells soon: a file descriptor may be another's by now.
        """
        ended: set[int] = set()
        while self._monitor.poll(0):
            ended.add(parse_monitor_message(self._monitor.recv_multipart())["value"])
        return {peer for peer, connection in self._connections.items() if connection in ended}

    def close(self) -> None:
        """Let go of the port, and of everything that waits to be sent."""
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
                head, *parts = self._socket.recv_multipart(flags=zmq.NOBLOCK, copy=False)
            except zmq.Again:
                return
            self._connections[head.bytes] = int(head.get(zmq.SRCFD))
            self._on_message(head.bytes, [part.bytes for part in parts])
        self._schedule_read()


def _bind_router(
    context: zmq.Context[zmq.Socket[bytes]], endpoint: str, *, monitor: zmq.Socket[bytes]
) -> zmq.Socket[bytes]:
    """Return the socket; all limits are set before it is bound, later they would not count.

    ends: a PAIR that is told of every connection that ended.
    """
    router = context.socket(zmq.ROUTER)
    router.set(zmq.BACKLOG, MAX_CONNECTIONS)
    router.set(zmq.SNDHWM, _SEND_HIGH_WATER_MARK)
    router.set(zmq.RCVHWM, _RECEIVE_HIGH_WATER_MARK)
    router.set(zmq.MAXMSGSIZE, _MAX_PART_BYTES)
    router.set(zmq.ROUTER_MANDATORY, 1)  # say who is gone or full, instead of dropping in silence
    router.set(zmq.HEARTBEAT_IVL, _PING_INTERVAL_MS)
    router.set(zmq.HEARTBEAT_TIMEOUT, _PING_TIMEOUT_MS)
    router.set(zmq.LINGER, 0)
    router.monitor(_MONITOR_ENDPOINT, zmq.EVENT_DISCONNECTED)
    monitor.set(zmq.RCVHWM, 0)  # nobody may have to wait for us to read it
    monitor.connect(_MONITOR_ENDPOINT)
    try:
        router.bind(endpoint)
    except zmq.ZMQError as error:
        said = f"{endpoint}: {error.strerror}: set TMPDIR to a short path that can be written"
        raise OSError(error.errno, said) from error
    return router
