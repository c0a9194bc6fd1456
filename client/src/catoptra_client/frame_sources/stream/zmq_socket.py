"""One DEALER socket to a stream server, and what was heard of it: the client's door to ZeroMQ.

ZeroMQ connects again by itself. Nothing is kept for a server that is away: an order that could not
be sent is not carried out minutes later.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import zmq

from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES

# A server that lives tells so every half second: three missed pulses are a lost server.
SERVER_TIMEOUT_S = 1.5
# Messages that wait for the program: frames come only when asked for, so these are pulses.
_RECEIVE_QUEUE_SIZE = 64
_MIN_RECONNECT_MS = 100
_MAX_RECONNECT_MS = 1000
# A connection whose other end vanished without a word is given up and made anew.
_ZMTP_PING_INTERVAL_MS = 1000
_ZMTP_PING_TIMEOUT_MS = 3000


class StreamSocket:
    """A socket that is connected, or on its way to be."""

    def __init__(
        self, host: str, port: int, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.address = f"{host}:{port}"
        self._clock = clock
        self._context = zmq.Context(io_threads=1)
        self._socket = self._context.socket(zmq.DEALER)
        for option, value in _SOCKET_OPTIONS.items():
            self._socket.set(option, value)
        name = f"[{host}]" if ":" in host else host
        self._socket.connect(f"tcp://{name}:{port}")
        self._last_received_s = self._clock()

    def close(self) -> None:
        """End the connection: the server removes the robot."""
        self._context.destroy(linger=0)

    def send(self, data: bytes, deadline_s: float) -> None:
        """Send a message as soon as there is a connection; ConnectionLostError if there is none."""
        left_s = deadline_s - self._clock()
        if not self._socket.poll(max(0, round(1000 * left_s)), zmq.POLLOUT):
            raise ConnectionLostError(
                f"no stream server at {self.address}: start catoptra-server, and check --host and "
                "--stream-port; it is tried again at the next call"
            )
        self._socket.send(data)

    def receive(self, deadline_s: float) -> list[bytes] | None:
        """Return the next message; None if none comes by then."""
        left_s = deadline_s - self._clock()
        if not self._socket.poll(max(0, round(1000 * left_s)), zmq.POLLIN):
            return None
        self._last_received_s = self._clock()
        return self._socket.recv_multipart()

    def is_lost(self) -> bool:
        """Return whether nothing at all is heard of the server; may wait for its next pulse."""
        while (left_s := self._last_received_s + SERVER_TIMEOUT_S - self._clock()) > 0.0:
            if self._socket.poll(max(1, round(1000 * left_s)), zmq.POLLIN):
                return False
        return True


_SOCKET_OPTIONS = {
    zmq.IPV6: 1,
    zmq.LINGER: 0,
    zmq.RCVHWM: _RECEIVE_QUEUE_SIZE,
    zmq.IMMEDIATE: 1,
    zmq.MAXMSGSIZE: MAX_IMAGE_PAYLOAD_BYTES,
    zmq.RECONNECT_IVL: _MIN_RECONNECT_MS,
    zmq.RECONNECT_IVL_MAX: _MAX_RECONNECT_MS,
    zmq.HEARTBEAT_IVL: _ZMTP_PING_INTERVAL_MS,
    zmq.HEARTBEAT_TIMEOUT: _ZMTP_PING_TIMEOUT_MS,
}
