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

# Without a connection: three missed heartbeats, since a live server sends one every half second.
_SERVER_TIMEOUT_S = 1.5
# With one: OpenGL in software compiles under the interpreter's lock, and beside ten other busy
# processes that takes longer than three heartbeats.
_SILENT_SERVER_TIMEOUT_S = 6.0
_CHECK_INTERVAL_S = 0.5
# Unread messages: frames arrive on request only, so the others are heartbeats.
_RECEIVE_QUEUE_SIZE = 64
_MIN_RECONNECT_MS = 100
# A restarted server is found within _SERVER_TIMEOUT_S, before a call gives up.
_MAX_RECONNECT_MS = 500
# A connection whose other end vanished without closing is ended after the timeout and made anew;
# that of a server which was only silent stays, and with it the robot.
_ZMTP_PING_INTERVAL_MS = 1000
_ZMTP_PING_TIMEOUT_MS = 10_000


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
        # A server that has never been there may be on its way; one that was is lost.
        self._has_received = False
        self._silent_since_s = self._clock()

    def close(self) -> None:
        """End the connection: the server removes the robot."""
        self._context.destroy(linger=0)

    def begin_wait(self) -> None:
        """Begin to wait for a reply: the server's silence counts from now on."""
        self._silent_since_s = self._clock()

    def send(self, data: bytes, deadline_s: float) -> None:
        """Send a message once there is a connection.

        Args:
            data: The single part.
            deadline_s: Time of the clock at which to stop waiting.

        Raises:
            ConnectionLostError: No connection before the deadline, or for _SERVER_TIMEOUT_S to a
                server that has been there.
        """
        lost_at_s = self._silent_since_s + _SERVER_TIMEOUT_S
        until_s = min(deadline_s, lost_at_s) if self._has_received else deadline_s
        while self._poll(until_s, zmq.POLLOUT):
            try:
                self._socket.send(data, zmq.NOBLOCK)
                return
            except zmq.Again:
                pass  # the connection has ended since: a send that waits would wait for ever
        raise ConnectionLostError(
            f"no stream server at {self.address}: start catoptra-server, and check --host and "
            "--stream-port; the next call tries again"
        )

    def receive(self, deadline_s: float) -> list[bytes] | None:
        """Next message; None if none arrives before the deadline.

        Raises:
            ConnectionLostError: The server has sent nothing for _SILENT_SERVER_TIMEOUT_S, or for
                _SERVER_TIMEOUT_S and has closed the connection.
        """
        while not self._wait_for_message(min(deadline_s, self._clock() + _CHECK_INTERVAL_S)):
            if self._clock() >= deadline_s:
                return None
        self._has_received = True
        self._silent_since_s = self._clock()
        return self._socket.recv_multipart()

    def check_alive(self) -> None:
        """Wait for the next sign of life of the server.

        Raises:
            ConnectionLostError: As `receive`.
        """
        while not self._wait_for_message(self._clock() + _CHECK_INTERVAL_S):
            pass

    def _wait_for_message(self, until_s: float) -> bool:
        """Whether a message arrives until then; raises ConnectionLostError for a lost server."""
        if self._poll(until_s, zmq.POLLIN):
            return True
        is_connected = self._poll(self._clock(), zmq.POLLOUT)
        timeout_s = _SILENT_SERVER_TIMEOUT_S if is_connected else _SERVER_TIMEOUT_S
        if self._clock() < self._silent_since_s + timeout_s:
            return False
        raise ConnectionLostError(
            f"lost the stream server at {self.address}: no heartbeat. See the log of the server; "
            "call again once it is back, and spawn again"
        )

    def _poll(self, until_s: float, event: int) -> bool:
        left_s = until_s - self._clock()
        return bool(self._socket.poll(max(0, round(1000 * left_s)), event))


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
