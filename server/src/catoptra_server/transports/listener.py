"""Listening sockets of the ports, and the loop that accepts their connections.

asyncio's own servers log a traceback for each failed `accept`, without a pause: 27 000 in a minute
without free descriptors.
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
from collections.abc import Callable

log = logging.getLogger(__name__)

# Connections that the kernel completes before they are accepted, six seconds at the rate below. One
# that does not fit is tried again by its peer's kernel after a second.
BACKLOG = 128
# Connections accepted in one turn of the loop; the others wait for a later one.
_MAX_ACCEPTS_PER_TURN = 16
# Connections accepted at once, and per second: opening and closing one takes 1 ms of the loop, and
# a flood of 240 a second took half of it. A newcomer waits in the backlog meanwhile.
_MAX_BURST = 64
_MAX_ACCEPTS_PER_S = 20.0
# Without a free descriptor a connection waits in the backlog; an immediate retry would fail again
# and only burn processor time.
_ACCEPT_RETRY_S = 1.0

# A peer whose machine or network is gone is noticed within 30 + 3 * 10 s.
_KEEPALIVE_OPTIONS = {"TCP_KEEPIDLE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3}

# A host that vanished is disconnected after this time, whether or not bytes are on their way to it;
# so is a client whose buffers stay full. The kernel of a busy program replies by itself.
_VANISHED_AFTER_S = 6
_VANISHED_OPTIONS = {
    "TCP_KEEPIDLE": _VANISHED_AFTER_S // 3,
    "TCP_KEEPINTVL": _VANISHED_AFTER_S // 3,
    "TCP_KEEPCNT": 2,
    "TCP_USER_TIMEOUT": 1000 * _VANISHED_AFTER_S,
}

# Receives an accepted socket and the address of the peer. An OSError closes the socket.
AcceptCallback = Callable[[socket.socket, str], None]

Listener = socket.socket


def create_listener(host: str, port: int, *, name: str) -> Listener:
    """Listening socket on an address of a host, an IPv4 one if the host has both.

    Args:
        host: Name or address; `::` accepts IPv4 and IPv6, an empty one every IPv4 address.
        port: TCP port; 0 = a free one.
        name: Name of the port in error messages.

    Raises:
        OSError: The address is not available; names port and host.
    """
    try:
        infos = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        # USARSim's clients speak IPv4, and `localhost` may be listed as ::1 first.
        infos.sort(key=lambda info: info[0] != socket.AF_INET)
        family, _, _, _, address = infos[0]
        # One socket for IPv4 and IPv6, where the system supports both on one.
        dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        listener = socket.create_server(
            address, family=family, backlog=BACKLOG, dualstack_ipv6=dual
        )
    except OSError as error:
        raise OSError(error.errno, f"{name} port {host}:{port}: {_describe(error)}") from error
    listener.setblocking(False)
    return listener


def set_vanished_timeout(accepted: socket.socket) -> None:
    """Disconnect a peer early whose host vanishes, or that reads nothing.

    Raises:
        OSError: The peer has left.
    """
    for option, value in _VANISHED_OPTIONS.items():
        if hasattr(socket, option):  # not all systems have all
            accepted.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


async def wait_for_connection(listener: Listener) -> None:
    """Wait until a connection is in the backlog of a listening socket that nobody else reads."""
    loop, connected = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(listener, connected.set)
    try:
        await connected.wait()
    finally:
        loop.remove_reader(listener)


class AcceptLoop:
    """Hands over each connection of a listening socket until it is closed."""

    def __init__(self, listener: socket.socket, accept: AcceptCallback, *, name: str) -> None:
        """Begin to accept; to be called from the event loop.

        Args:
            listener: Listening socket, which the loop owns from now on.
            accept: Receives each connection; an OSError closes it and is logged.
            name: Name of the port in the log.
        """
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._accept = accept
        self._name = name
        self._num_failures = 0
        # Accepts that may follow at once, at a time of the loop's clock.
        self._num_free = float(_MAX_BURST)
        self._counted_at_s = self._loop.time()
        self._listen()

    @property
    def port(self) -> int:
        """TCP port of the listening socket."""
        port: int = self._listener.getsockname()[1]
        return port

    def close(self) -> None:
        """Release the port; accepted connections stay open."""
        if self._listener.fileno() >= 0:
            self._loop.remove_reader(self._listener)
            self._listener.close()

    def _listen(self) -> None:
        # The socket may have been closed while a retry was pending.
        if self._listener.fileno() >= 0:
            self._loop.add_reader(self._listener, self._accept_waiting)

    def _accept_waiting(self) -> None:
        for _ in range(min(_MAX_ACCEPTS_PER_TURN, self._count_free())):
            try:
                accepted, address = self._listener.accept()
            # None left, or the peer has disconnected between the event and this call.
            except (BlockingIOError, ConnectionAbortedError):
                return
            except OSError as error:
                self._log_failure(error)
                self._pause(_ACCEPT_RETRY_S)
                return
            self._num_free -= 1.0
            self._hand_over(accepted, "{}:{}".format(*address[:2]))
        if self._num_free < 1.0:
            self._pause((1.0 - self._num_free) / _MAX_ACCEPTS_PER_S)

    def _count_free(self) -> int:
        """Number of connections that may be accepted now."""
        now_s = self._loop.time()
        earned = _MAX_ACCEPTS_PER_S * (now_s - self._counted_at_s)
        self._num_free = min(self._num_free + earned, float(_MAX_BURST))
        self._counted_at_s = now_s
        return int(self._num_free)

    def _hand_over(self, accepted: socket.socket, address: str) -> None:
        try:
            accepted.setblocking(False)
            _set_options(accepted)
            self._accept(accepted, address)
        except OSError as error:
            log.warning("connection of %s to the %s port closed: %s", address, self._name, error)
            accepted.close()

    def _log_failure(self, error: OSError) -> None:
        self._num_failures += 1
        log.warning(
            "the %s port accepts no connection for %g s (%d times so far): %s",
            *(self._name, _ACCEPT_RETRY_S, self._num_failures, error.strerror),
        )

    def _pause(self, duration_s: float) -> None:
        self._loop.remove_reader(self._listener)
        self._loop.call_later(duration_s, self._listen)


def _set_options(end: socket.socket) -> None:
    # A reply must not wait for the acknowledgement of the one before. asyncio sets this only on
    # sockets whose protocol number is stated, which those of `accept` do not.
    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in _KEEPALIVE_OPTIONS.items():
        if hasattr(socket, option):
            end.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


def _describe(error: OSError) -> str:
    """Reason without the address, which `socket.create_server` appends."""
    # Errors of getaddrinfo have negative numbers, which the system has no text for.
    if error.errno is None or error.errno < 0:
        return str(error.strerror)
    return os.strerror(error.errno)
