"""The public port of the stream: a relay to the private ROUTER that limits what clients can use.

Bytes pass both ways, unchanged but for the identity of a client, over a local socket that only this
user can open. A message without an end, a flood of requests, a connection without a request: each
is held back or ended here, where ZeroMQ has no limit. At most one read per direction is buffered:
bytes that the ROUTER does not accept stay in the client's TCP connection, and vice versa. Measured
in tests/measurements/unterminated_messages.py.
"""

from __future__ import annotations

import asyncio
import logging
import select
import socket
import struct
from collections.abc import Callable

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.transports.listener import AcceptLoop, set_vanished_timeout
from catoptra_server.transports.loop_share import LoopAccount
from catoptra_server.transports.stream.relay import Relay
from catoptra_server.transports.stream.zmtp_identity import IdentityFilter
from catoptra_server.transports.stream.zmtp_part_limit import ZmtpPartCounter
from catoptra_server.transports.tcp_server import ConnectionLimits

log = logging.getLogger(__name__)

# All clients and some more, which get an error in reply.
MAX_CONNECTIONS = 288
# The client's socket, and two ends of the local one.
DESCRIPTORS_PER_CONNECTION = 3
# Requests are small: one read is a few of them, so that a flood is held back before it has cost
# much.
_UPSTREAM_READ_BYTES = 1024
# A frame should take few turns of the loop.
_DOWNSTREAM_READ_BYTES = 256 * 1024
# Time of the loop for a request with its reply, measured as 0.12 to 0.19 ms, and as much of the
# thread of ZeroMQ; for a part, and for a read.
_MESSAGE_COST_S = 0.4e-3
_PART_COST_S = 2e-6
_READ_COST_S = 50e-6
# A read of the smallest messages costs 0.1 s, and ten thousand seconds of a flood of many clients.
_MAX_WAIT_S = 60.0
_CHECK_INTERVAL_S = 0.25


class ConnectionGuard:
    """The connections of a listening socket to the Unix socket at a path."""

    def __init__(self, listener: socket.socket, path: str, *, limits: ConnectionLimits) -> None:
        """Begin to accept connections.

        Args:
            listener: Listening socket, which the guard owns from now on.
            path: Path of the ROUTER's socket.
            limits: Number of connections, and time for the first request; there is no limit of
                idleness, since TCP checks idle connections.
        """
        self._loop = asyncio.get_running_loop()
        self._path = path
        self._limits = limits
        # In the order of acceptance.
        self._connections: dict[_GuardedConnection, None] = {}
        self._accept_loop = AcceptLoop(listener, self._accept, name="stream")
        self._check = self._loop.call_later(_CHECK_INTERVAL_S, self._check_connections)

    def close(self) -> None:
        """Release the port and close every connection."""
        self._accept_loop.close()
        self._check.cancel()
        for connection in list(self._connections):
            connection.close()

    def _accept(self, client_socket: socket.socket, address: str) -> None:
        if len(self._connections) >= self._limits.max_connections and not self._make_room():
            limit = f"the limit of {self._limits.max_connections} connections is reached"
            raise ConnectionRefusedError(limit)
        set_vanished_timeout(client_socket)
        router_socket = socket.socket(socket.AF_UNIX)
        try:
            router_socket.setblocking(False)
            router_socket.connect(self._path)
        except OSError:
            router_socket.close()
            raise
        connection = _GuardedConnection(
            client_socket,
            router_socket,
            address=address,
            account=self._limits.loop_share.open_account(max_wait_s=_MAX_WAIT_S),
            on_close=self._connections.pop,
        )
        self._connections[connection] = None

    def _make_room(self) -> bool:
        """Close the oldest connection without a whole request; False if there is none."""
        oldest = next((one for one in self._connections if not one.has_request), None)
        if oldest is None:
            return False
        log.info("stream connection of %s closed for a newcomer: no request", oldest.address)
        oldest.close()
        return True

    def _check_connections(self) -> None:
        """Close connections without a request in time, and those that the ROUTER has ended."""
        self._check = self._loop.call_later(_CHECK_INTERVAL_S, self._check_connections)
        limit_s = self._limits.handshake_timeout_s
        opened_before_s = self._loop.time() - limit_s
        for connection in list(self._connections):
            if limit_s and not connection.has_request and connection.opened_s < opened_before_s:
                log.info(
                    "stream connection of %s closed: no request in %g s",
                    *(connection.address, limit_s),
                )
                connection.close()
        self._close_orphans()

    def _close_orphans(self) -> None:
        """Close connections whose end of the ROUTER is shut down while the client reads nothing."""
        blocked = {one.router_fd: one for one in self._connections if one.is_client_blocked}
        poll = select.poll()
        for descriptor in blocked:
            poll.register(descriptor, 0)  # hang-ups and errors are always reported
        for descriptor, _ in poll.poll(0):
            blocked[descriptor].close()


class _GuardedConnection:
    """The two sockets of one client; both end when either does."""

    def __init__(
        self,
        client_socket: socket.socket,
        router_socket: socket.socket,
        *,
        address: str,
        account: LoopAccount,
        on_close: Callable[[_GuardedConnection], object],
    ) -> None:
        self._sockets = (client_socket, router_socket)
        self.address = address
        self.opened_s = asyncio.get_running_loop().time()
        self._account = account
        self._on_close = on_close
        self._counter = ZmtpPartCounter()
        self._identity_filter = IdentityFilter()
        # Whether ZeroMQ has sent anything since the last read from the client.
        self._has_replied = True
        self._upstream = Relay(
            client_socket,
            router_socket,
            read_bytes=_UPSTREAM_READ_BYTES,
            inspect=self._inspect,
            on_end=self._close_on_error,
        )
        self._downstream = Relay(
            router_socket,
            client_socket,
            read_bytes=_DOWNSTREAM_READ_BYTES,
            inspect=self._note_reply,
            on_end=self._close_on_error,
        )

    @property
    def has_request(self) -> bool:
        """Whether the client has sent a whole message."""
        return self._counter.num_messages > 0

    @property
    def router_fd(self) -> int:
        """Descriptor of the socket to the ROUTER."""
        return self._sockets[1].fileno()

    @property
    def is_client_blocked(self) -> bool:
        """Whether bytes wait for the client to read."""
        return self._downstream.is_blocked

    def close(self) -> None:
        """Close both sockets; reset the connection of a client that reads nothing."""
        if self.is_client_blocked:
            # Otherwise the kernel would keep megabytes for minutes, and the client notice no end.
            no_linger = struct.pack("ii", 1, 0)
            self._sockets[0].setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, no_linger)
        # Callbacks first: the number of a closed descriptor may be reused at once.
        self._upstream.close()
        self._downstream.close()
        for end in self._sockets:
            end.close()
        self._on_close(self)

    def _inspect(self, data: bytes) -> tuple[bytes, float]:
        """Count the messages of a read; the bytes for ZeroMQ, and the time until the next read."""
        num_messages, num_parts = self._counter.num_messages, self._counter.num_parts
        # A part beyond the limit must not reach libzmq.
        self._counter.feed(data)
        # A client that waits for each reply occupies the loop with one request at any time.
        if self._has_replied and self._counter.num_messages <= num_messages + 1:
            self._account.write_off()
        self._has_replied = False
        self._account.charge(
            _READ_COST_S
            + _MESSAGE_COST_S * (self._counter.num_messages - num_messages)
            + _PART_COST_S * (self._counter.num_parts - num_parts)
        )
        return self._identity_filter.feed(data), self._account.remaining_wait_s

    def _note_reply(self, data: bytes) -> tuple[bytes, float]:
        """Pass all bytes of the ROUTER, which is ours, at once."""
        self._has_replied = True
        return data, 0.0

    def _close_on_error(self, reason: Exception | None) -> None:
        # Only violations are logged here; StreamServer logs clients that disconnect.
        if isinstance(reason, RemoteProtocolError):
            log.info("stream connection of %s ended: %s", self.address, reason)
        self.close()
