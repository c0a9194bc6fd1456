"""The public port of the stream: a relay to the private ROUTER that ends endless messages.

Bytes pass unchanged both ways, over a local socket that only this user can open. At most one read
per direction is buffered here: bytes that the ROUTER does not accept stay in the client's TCP
connection, and vice versa. Measured in tests/measurements/unterminated_messages.py.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.transports.stream.zmtp_part_limit import ZmtpPartCounter

log = logging.getLogger(__name__)

# All clients and some more, which get an error in reply; each takes three file descriptors, and
# many systems give a process 1024.
MAX_CONNECTIONS = 288
# Requests are small; a frame should take few turns of the loop.
_UPSTREAM_READ_BYTES = 8 * 1024
_DOWNSTREAM_READ_BYTES = 256 * 1024
# Without a free descriptor a connection waits in the backlog; an immediate retry would fail again
# and only burn processor time.
_ACCEPT_RETRY_S = 1.0

CheckBytes = Callable[[bytes], None]
CloseCallback = Callable[[Exception | None], None]


def create_listener(host: str, port: int) -> socket.socket:
    """Listening socket on the first address of a host.

    Raises:
        OSError: The address is not available; names host and port.
    """
    try:
        infos = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, _, _, _, address = infos[0]
        # One socket for IPv4 and IPv6, where the system supports both on one.
        dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        listener = socket.create_server(
            address, family=family, backlog=MAX_CONNECTIONS, dualstack_ipv6=dual
        )
    except OSError as error:
        raise OSError(error.errno, f"stream port {host}:{port}: {error.strerror}") from error
    listener.setblocking(False)
    return listener


class ConnectionGuard:
    """A listening socket, and its connections to the Unix socket at `path`."""

    def __init__(self, listener: socket.socket, path: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._path = path
        self._connections: set[_GuardedConnection] = set()
        self._listen()

    def close(self) -> None:
        """Release the port and close every connection."""
        self._loop.remove_reader(self._listener)
        self._listener.close()
        for connection in list(self._connections):
            connection.close()

    def _listen(self) -> None:
        # The guard may have been closed while a retry was pending.
        if self._listener.fileno() >= 0:
            self._loop.add_reader(self._listener, self._accept)

    def _accept(self) -> None:
        try:
            client_socket, address = self._listener.accept()
        # The client has disconnected between the event and this call.
        except (BlockingIOError, ConnectionAbortedError):
            return
        except OSError as error:
            log.warning("stream port accepts no connection for %g s: %s", _ACCEPT_RETRY_S, error)
            self._loop.remove_reader(self._listener)
            self._loop.call_later(_ACCEPT_RETRY_S, self._listen)
            return
        try:
            self._open_connection(client_socket, address[0])
        except OSError as error:
            log.warning("stream connection of %s closed: %s", address[0], error)
            client_socket.close()

    def _open_connection(self, client_socket: socket.socket, client_host: str) -> None:
        if len(self._connections) >= MAX_CONNECTIONS:
            raise OSError(f"the limit of {MAX_CONNECTIONS} connections is reached")
        # A reply must not wait for the acknowledgement of the one before.
        client_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        router_socket = socket.socket(socket.AF_UNIX)
        try:
            for end in (client_socket, router_socket):
                end.setblocking(False)
            router_socket.connect(self._path)
        except OSError:
            router_socket.close()
            raise
        connection = _GuardedConnection(
            client_socket,
            router_socket,
            client_host=client_host,
            on_close=self._connections.discard,
        )
        self._connections.add(connection)


class _GuardedConnection:
    """The two sockets of one client; both end when either does."""

    def __init__(
        self,
        client_socket: socket.socket,
        router_socket: socket.socket,
        *,
        client_host: str,
        on_close: Callable[[_GuardedConnection], None],
    ) -> None:
        self._sockets = (client_socket, router_socket)
        self._client_host = client_host
        self._on_close = on_close
        check = ZmtpPartCounter().feed
        _Relay(
            client_socket,
            router_socket,
            read_bytes=_UPSTREAM_READ_BYTES,
            check=check,
            on_end=self._close_on_error,
        )
        _Relay(
            router_socket,
            client_socket,
            read_bytes=_DOWNSTREAM_READ_BYTES,
            check=_accept_any,
            on_end=self._close_on_error,
        )

    def close(self) -> None:
        """Close both sockets."""
        loop = asyncio.get_running_loop()
        # Callbacks first: the number of a closed descriptor may be reused at once.
        for end in self._sockets:
            loop.remove_reader(end)
            loop.remove_writer(end)
            end.close()
        self._on_close(self)

    def _close_on_error(self, reason: Exception | None) -> None:
        # Only violations are logged here; StreamServer logs clients that disconnect.
        if isinstance(reason, RemoteProtocolError):
            log.info("stream connection of %s ended: %s", self._client_host, reason)
        self.close()


class _Relay:
    """One direction of a connection; reads nothing more until the sink has accepted everything."""

    def __init__(
        self,
        source: socket.socket,
        sink: socket.socket,
        *,
        read_bytes: int,
        check: CheckBytes,
        on_end: CloseCallback,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._source = source
        self._sink = sink
        self._read_bytes = read_bytes
        self._check = check
        self._on_end = on_end
        self._pending = memoryview(b"")
        self._loop.add_reader(source, self._receive)

    def _receive(self) -> None:
        try:
            data = self._source.recv(self._read_bytes)
            # Before the bytes are relayed: a part beyond the limit must not reach libzmq.
            self._check(data)
        except BlockingIOError:
            return
        except (OSError, RemoteProtocolError) as error:
            self._on_end(error)
            return
        if not data:
            self._on_end(None)
            return
        self._pending = memoryview(data)
        # Backpressure: with bytes pending the source is not read, and TCP stops its sender.
        if self._send_pending() and self._pending:
            self._loop.remove_reader(self._source)
            self._loop.add_writer(self._sink, self._resume_sending)

    def _resume_sending(self) -> None:
        if self._send_pending() and not self._pending:
            self._loop.remove_writer(self._sink)
            self._loop.add_reader(self._source, self._receive)

    def _send_pending(self) -> bool:
        """Send as much as the sink accepts; False if the connection has ended."""
        try:
            self._pending = self._pending[self._sink.send(self._pending) :]
        except BlockingIOError:
            pass
        except OSError as error:
            self._on_end(error)
            return False
        return True


def _accept_any(_: bytes) -> None:
    """Pass all bytes of the ROUTER, which is ours."""
