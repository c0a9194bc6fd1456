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

from catoptra_server.transports.zmq_stream_turnstile import (
    MOST_CONNECTIONS,
    Turnstile,
    listening_socket,
)

# Messages that wait for one peer, beside what its TCP connection holds. A peer that keeps to one
# request a time never has more than one frame, one answer and some pulses there.
_WAITING_FOR_PEER = 8
# Messages of one peer that wait for us; the rest stays in TCP, which holds the peer back.
_WAITING_FROM_PEER = 16
# A part that is announced longer ends its connection before memory is taken for it.
_LARGEST_PART_BYTES = 8 * 1024
# Messages read in one go, before other work of the loop has its turn.
_READ_AT_ONCE = 32
# A peer whose host vanished without a word is given up after this silence of its connection; a
# living process answers from ZeroMQ's own thread, however busy it is.
_PING_EVERY_MS = 2000
_GIVE_UP_AFTER_MS = 6000
_ENDS = "inproc://ends"

Received = Callable[[bytes, list[bytes]], None]


class Sent(Enum):
    """What became of a message."""

    YES = auto()
    PEER_IS_FULL = auto()
    PEER_IS_GONE = auto()


class RouterSocket:
    """A bound socket. `received` is called with a peer's identity and the parts it sent."""

    def __init__(self, host: str, port: int, received: Received) -> None:
        self._loop = asyncio.get_running_loop()
        self._received = received
        with ExitStack() as kept:
            listener = kept.enter_context(listening_socket(host, port))
            self.port: int = listener.getsockname()[1]
            # A directory of 0700: nobody else gets round the turnstile.
            path = kept.enter_context(TemporaryDirectory(prefix="catoptra-")) + "/stream"
            context = zmq.Context(io_threads=1)
            kept.callback(context.destroy, linger=0)
            self._ends = context.socket(zmq.PAIR)
            self._socket = _bound(context, f"ipc://{path}", ends=self._ends)
            kept.callback(Turnstile(listener, path).close)
            self._let_go = kept.pop_all().close
        self._connections: dict[bytes, int] = {}
        self._is_closed = False
        self._reading: asyncio.Handle | None = None
        self._loop.add_reader(self._socket.FD, self._read)
        self._read_soon()

    def send(self, peer: bytes, parts: Sequence[bytes]) -> Sent:
        """Send a message at once, or not at all; once this is closed, nobody is there."""
        if self._is_closed:
            return Sent.PEER_IS_GONE
        sent = self._try_to_send(peer, parts)
        if sent is Sent.PEER_IS_FULL:
            # ZeroMQ takes note of what peers have taken only now and then, unless asked what is up.
            self._socket.get(zmq.EVENTS)
            sent = self._try_to_send(peer, parts)
        # Both may take the one readiness that the file descriptor tells of.
        self._read_soon()
        return sent

    def _try_to_send(self, peer: bytes, parts: Sequence[bytes]) -> Sent:
        try:
            self._socket.send_multipart([peer, *parts], flags=zmq.NOBLOCK)
        except zmq.Again:
            return Sent.PEER_IS_FULL
        except zmq.ZMQError as error:
            if error.errno != errno.EHOSTUNREACH:
                raise
            self._connections.pop(peer, None)
            return Sent.PEER_IS_GONE
        return Sent.YES

    def suspects(self) -> set[bytes]:
        """Return peers that may be gone: a connection ended where theirs was since the last call.

        Whether it was theirs, sending tells soon: a file descriptor may be another's by now.
        """
        ended: set[int] = set()
        while self._ends.poll(0):
            ended.add(parse_monitor_message(self._ends.recv_multipart())["value"])
        return {peer for peer, connection in self._connections.items() if connection in ended}

    def close(self) -> None:
        """Let go of the port, and of everything that waits to be sent."""
        self._is_closed = True
        self._loop.remove_reader(self._socket.FD)
        if self._reading is not None:
            self._reading.cancel()
        self._let_go()

    def _read_soon(self) -> None:
        if self._reading is None:
            self._reading = self._loop.call_soon(self._read_again)

    def _read_again(self) -> None:
        self._reading = None
        self._read()

    def _read(self) -> None:
        for _ in range(_READ_AT_ONCE):
            try:
                head, *parts = self._socket.recv_multipart(flags=zmq.NOBLOCK, copy=False)
            except zmq.Again:
                return
            self._connections[head.bytes] = int(head.get(zmq.SRCFD))
            self._received(head.bytes, [part.bytes for part in parts])
        self._read_soon()


def _bound(
    context: zmq.Context[zmq.Socket[bytes]], endpoint: str, *, ends: zmq.Socket[bytes]
) -> zmq.Socket[bytes]:
    """Return the socket; all limits are set before it is bound, later they would not count.

    ends: a PAIR that is told of every connection that ended.
    """
    router = context.socket(zmq.ROUTER)
    router.set(zmq.BACKLOG, MOST_CONNECTIONS)
    router.set(zmq.SNDHWM, _WAITING_FOR_PEER)
    router.set(zmq.RCVHWM, _WAITING_FROM_PEER)
    router.set(zmq.MAXMSGSIZE, _LARGEST_PART_BYTES)
    router.set(zmq.ROUTER_MANDATORY, 1)  # say who is gone or full, instead of dropping in silence
    router.set(zmq.HEARTBEAT_IVL, _PING_EVERY_MS)
    router.set(zmq.HEARTBEAT_TIMEOUT, _GIVE_UP_AFTER_MS)
    router.set(zmq.LINGER, 0)
    router.monitor(_ENDS, zmq.EVENT_DISCONNECTED)
    ends.set(zmq.RCVHWM, 0)  # nobody may have to wait for us to read it
    ends.connect(_ENDS)
    try:
        router.bind(endpoint)
    except zmq.ZMQError as error:
        said = f"{endpoint}: {error.strerror}: set TMPDIR to a short path that can be written"
        raise OSError(error.errno, said) from error
    return router
