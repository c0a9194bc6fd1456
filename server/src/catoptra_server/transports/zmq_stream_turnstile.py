"""The stream's public port: all pass to the ROUTER behind it but messages that do not end.

Bytes go both ways unchanged, over a local socket that only this user can open. One read each way
waits here at most: what the ROUTER does not take stays in the client's TCP connection, and what the
client does not take in the ROUTER. Measured in tests/cost/questions/endless_messages.py.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.transports.zmtp_upstream import UpstreamParts

log = logging.getLogger(__name__)

# All clients that are served and some to refuse in words; each takes three file descriptors, and
# many systems give a process 1024.
MOST_CONNECTIONS = 288
# Requests are small. A frame should take few turns of the loop.
_READ_UP_BYTES = 8 * 1024
_READ_DOWN_BYTES = 256 * 1024
# Without a free descriptor a connection waits at the port; asking at once again burns time only.
_ACCEPT_AGAIN_S = 1.0

Check = Callable[[bytes], None]
End = Callable[[Exception | None], None]


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket on a host's first address. Raises OSError that names host and port."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, _, _, _, address = found[0]
        dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        listener = socket.create_server(
            address, family=family, backlog=MOST_CONNECTIONS, dualstack_ipv6=dual
        )
    except OSError as error:
        raise OSError(error.errno, f"stream port {host}:{port}: {error.strerror}") from error
    listener.setblocking(False)
    return listener


class Turnstile:
    """A listening socket, and all who came in by it to the Unix socket at `path`."""

    def __init__(self, listener: socket.socket, path: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._path = path
        self._passages: set[_Passage] = set()
        self._listen()

    def close(self) -> None:
        """Let go of the port and of every connection."""
        self._loop.remove_reader(self._listener)
        self._listener.close()
        for passage in list(self._passages):
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
            log.warning("stream port takes nobody for %g s: %s", _ACCEPT_AGAIN_S, error)
            self._loop.remove_reader(self._listener)
            self._loop.call_later(_ACCEPT_AGAIN_S, self._listen)
            return
        try:
            self._let_in(outside, address[0])
        except OSError as error:
            log.warning("stream connection of %s closed: %s", address[0], error)
            outside.close()

    def _let_in(self, outside: socket.socket, name: str) -> None:
        if len(self._passages) >= MOST_CONNECTIONS:
            raise OSError(f"{MOST_CONNECTIONS} connections are there")
        outside.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        inside = socket.socket(socket.AF_UNIX)
        try:
            for end in (outside, inside):
                end.setblocking(False)
            inside.connect(self._path)
        except OSError:
            inside.close()
            raise
        self._passages.add(_Passage(outside, inside, name=name, ended=self._passages.discard))


class _Passage:
    """One client's two sockets; both end when either does."""

    def __init__(
        self,
        outside: socket.socket,
        inside: socket.socket,
        *,
        name: str,
        ended: Callable[[_Passage], None],
    ) -> None:
        self._ends = (outside, inside)
        self._name = name
        self._ended = ended
        check = UpstreamParts().feed
        _Flow(outside, inside, read_bytes=_READ_UP_BYTES, check=check, end=self._end)
        _Flow(inside, outside, read_bytes=_READ_DOWN_BYTES, check=_anything, end=self._end)

    def close(self) -> None:
        """End both connections."""
        loop = asyncio.get_running_loop()
        for end in self._ends:
            loop.remove_reader(end)
            loop.remove_writer(end)
            end.close()
        self._ended(self)

    def _end(self, reason: Exception | None) -> None:
        if isinstance(reason, RemoteProtocolError):
            log.info("stream connection of %s ended: %s", self._name, reason)
        self.close()


class _Flow:
    """One way of a passage. While the sink does not take what was read, nothing more is read."""

    def __init__(
        self,
        source: socket.socket,
        sink: socket.socket,
        *,
        read_bytes: int,
        check: Check,
        end: End,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._source = source
        self._sink = sink
        self._read_bytes = read_bytes
        self._check = check
        self._end = end
        self._waiting = memoryview(b"")
        self._loop.add_reader(source, self._take)

    def _take(self) -> None:
        try:
            data = self._source.recv(self._read_bytes)
            self._check(data)
        except BlockingIOError:
            return
        except (OSError, RemoteProtocolError) as error:
            self._end(error)
            return
        if not data:
            self._end(None)
            return
        self._waiting = memoryview(data)
        if self._gave() and self._waiting:
            self._loop.remove_reader(self._source)
            self._loop.add_writer(self._sink, self._give)

    def _give(self) -> None:
        if self._gave() and not self._waiting:
            self._loop.remove_writer(self._sink)
            self._loop.add_reader(self._source, self._take)

    def _gave(self) -> bool:
        """Give what the sink takes; return whether the passage still stands."""
        try:
            self._waiting = self._waiting[self._sink.send(self._waiting) :]
        except BlockingIOError:
            pass
        except OSError as error:
            self._end(error)
            return False
        return True


def _anything(_: bytes) -> None:
    """Pass what the ROUTER says."""
