"""The DEALER socket of a stream client, and the liveness of its server.

The only module of the client that imports zmq. ZeroMQ reconnects by itself. Nothing is queued for a
server that is down: a drive command must not be executed minutes later.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import zmq

from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES

# Three missed heartbeats: a live server sends one every half second.
SERVER_TIMEOUT_S = 1.5
# Unread messages: frames arrive on request only, so the others are heartbeats.
_RECEIVE_QUEUE_SIZE = 64
_MIN_RECONNECT_MS = 100
_MAX_RECONNECT_MS = 1000
# A connection whose other end vanished without closing is ended after the timeout and made anew.
_ZMTP_PING_INTERVAL_MS = 1000
_ZMTP_PING_TIMEOUT_MS = 3000


class StreamSocket:
    """A socket that is connected, or connecting."""

    def __init__(
        self, host: str, port: int, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.address = f"{host}:{port}"
        self._clock = clock
        self._context = zmq.Context(io_threads=1)
        self._socket = self._context.socket(zmq.DEALER)
        for option, value in _SOCKET_OPTIONS.items():
            self._socket.set(option, value)
        # An IPv6 address has colons of its own.
        name = f"[{host}]" if ":" in host else host
        self._socket.connect(f"tcp://{name}:{port}")
        self._last_received_s = self._clock()

    def close(self) -> None:
        """End the connection: the server removes the robot."""
        self._context.destroy(linger=0)

    def send(self, data: bytes, deadline_s: float) -> None:
        """Send a message once there is a connection.

        Args:
            data: The single part.
            deadline_s: Time of the clock at which to stop waiting.

        Raises:
            ConnectionLostError: No connection before the deadline.
        """
        left_s = deadline_s - self._clock()
        if not self._socket.poll(max(0, round(1000 * left_s)), zmq.POLLOUT):
            raise ConnectionLostError(
                f"no stream server at {self.address}: start catoptra-server, and check --host and "
                "--stream-port; the next call tries again"
            )
        self._socket.send(data)

    def receive(self, deadline_s: float) -> list[bytes] | None:
        """Next message; None if none arrives before the deadline."""
        left_s = deadline_s - self._clock()
        if not self._socket.poll(max(0, round(1000 * left_s)), zmq.POLLIN):
            return None
        self._last_received_s = self._clock()
        return self._socket.recv_multipart()

    def is_lost(self) -> bool:
        """Whether the server sends nothing at all; may wait for its next heartbeat."""
        # At most SERVER_TIMEOUT_S after the last message, so a lost server is reported soon after
        # the deadline of the call.
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
