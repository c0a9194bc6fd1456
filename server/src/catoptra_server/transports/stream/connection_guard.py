"""The stream's public port: all pass to the ROUTER behind it but messages that do not end.

Bytes go both ways unchanged, over a local socket that only this user can open. One read each way
waits here at most: what the ROUTER does not take stays in the client's TCP connection, and what the
client does not take in the ROUTER. Measured in tests/measurements/unterminated_messages.py.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.transports.stream.zmtp_part_limit import ZmtpPartCounter

log = logging.getLogger(__name__)

# All clients that are served and some to refuse in words; each takes three file descriptors, and
# many systems give a process 1024.
MAX_CONNECTIONS = 288
# Requests are small. A frame should take few turns of the loop.
_UPSTREAM_READ_BYTES = 8 * 1024
_DOWNSTREAM_READ_BYTES = 256 * 1024
# Without a free descriptor a connection waits at the port; asking at once again burns time only.
_ACCEPT_RETRY_S = 1.0

CheckBytes = Callable[[bytes], None]
CloseCallback = Callable[[Exception | None], None]


def create_listener(host: str, port: int) -> socket.socket:
    """Return a socket on a host's first address. Raises OSError that names host and port."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, _, _, _, address = found[0]
        dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        listener = socket.create_server(
            address, family=family, backlog=MAX_CONNECTIONS, dualstack_ipv6=dual
        )
    except OSError as error:
        raise OSError(error.errno, f"stream port {host}:{port}: {error.strerror}") from error
    listener.setblocking(False)
    return listener


class ConnectionGuard:
    """A listening socket, and all who came in by it to the Unix socket at `path`."""

    def __init__(self, listener: socket.socket, path: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._path = path
        self._connections: set[_GuardedConnection] = set()
        self._listen()

    def close(self) -> None:
        """Let go of the port and of every connection."""
        self._loop.remove_reader(self._listener)
        self._listener.close()
        for passage in list(self._connections):
            passage.close()

    def _listen(self) -> None:
        if self._listener.fileno() >= 0:
            self._loop.add_reader(self._listener, self._accept)

    def _accept(self) -> None:
        try:
            outside, address = self._listener.accept()
        except (BlockingIOError, ConnectionAbortedError):
            return
        except OSError as error:
            log.warning("stream port takes nobody for %g s: %s", _ACCEPT_RETRY_S, error)
            self._loop.remove_reader(self._listener)
            self._loop.call_later(_ACCEPT_RETRY_S, self._listen)
            return
        try:
            self._open_connection(outside, address[0])
        except OSError as error:
            log.warning("stream connection of %s closed: %s", address[0], error)
            outside.close()

    def _open_connection(self, client_socket: socket.socket, client_host: str) -> None:
        if len(self._connections) >= MAX_CONNECTIONS:
            raise OSError(f"{MAX_CONNECTIONS} connections are there")
        client_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        inside = socket.socket(socket.AF_UNIX)
        try:
            for end in (client_socket, inside):
                end.setblocking(False)
            inside.connect(self._path)
        except OSError:
            inside.close()
            raise
        self._connections.add(
            _GuardedConnection(
                client_socket, inside, client_host=client_host, on_close=self._connections.discard
            )
        )


class _GuardedConnection:
    """One client's two sockets; both end when either does."""

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
        """End both connections."""
        loop = asyncio.get_running_loop()
        for end in self._sockets:
            loop.remove_reader(end)
            loop.remove_writer(end)
            end.close()
        self._on_close(self)

    def _close_on_error(self, reason: Exception | None) -> None:
        if isinstance(reason, RemoteProtocolError):
            log.info("stream connection of %s ended: %s", self._client_host, reason)
        self.close()


class _Relay:
    """One way of a passage. While the sink does not take what was read, nothing more is read."""

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
        if self._send_pending() and self._pending:
            self._loop.remove_reader(self._source)
            self._loop.add_writer(self._sink, self._resume_sending)

    def _resume_sending(self) -> None:
        if self._send_pending() and not self._pending:
            self._loop.remove_writer(self._sink)
            self._loop.add_reader(self._source, self._receive)

    def _send_pending(self) -> bool:
        """Give what the sink takes; return whether the passage still stands."""
        try:
            self._pending = self._pending[self._sink.send(self._pending) :]
        except BlockingIOError:
            pass
        except OSError as error:
            self._on_end(error)
            return False
        return True


def _accept_any(_: bytes) -> None:
    """Pass what the ROUTER says."""
