"""A listening port: who may connect, how many, and who makes room for a newcomer.

One set of rules for control, image, stream and page. At the limit the connection that is needed
least ends. It is one that neither has a robot nor watches one: first those whose peer has left,
then those that have sent nothing valid, then the oldest. Such connections may fill three quarters
of the places; the rest is kept for those that have a robot, watch one, or are younger than 10 s. So
neither silent connections nor idle ones shut newcomers out, and an idle controller may wait for its
user all day while there is room.

* **Sockets are accepted here**, since asyncio's own servers log a traceback for each failed
  `accept`, without a pause: 27 000 in a minute without free descriptors.
* **A storm costs its sender.** Opening and closing a connection takes 1 ms of the loop, so 20 a
  second are opened after the first 64. Accepted sockets wait for that; one that has been closed
  meanwhile costs next to nothing, and one that has sent something of the port's protocol comes
  first: behind 240 silent connections a second a newcomer waited for 2 to 6 s.
"""

from __future__ import annotations

import asyncio
import logging
import os
import re
import select
import socket
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import field
from ipaddress import ip_address
from typing import Generic, Protocol, TypeVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.memory import release_freed_memory
from catoptra_server.serve.limits import (
    MAX_BLOCKED_S,
    MAX_BURST,
    MAX_CONNECTIONS,
    MAX_OPENED_PER_S,
    MAX_PER_ADDRESS,
    NEWCOMER_AGE_S,
    LoopShare,
    find_shared_address,
)

log = logging.getLogger(__name__)
Listener = socket.socket
# Connections that the kernel completes before they are accepted. One that does not fit is tried
# again by the peer's kernel after a second.
BACKLOG = 128
# Sockets accepted in one turn of the loop, and those that wait to be opened.
_MAX_ACCEPTS_PER_TURN = 64
_MAX_WAITING = 256
_WaitingSocket = tuple[socket.socket, str]
# Bytes that tell what a client is: of the greeting of ZeroMQ.
_MAX_FIRST_BYTES = 10
_ANY_BYTES = re.compile(b"")
_IPV4_ADDRESS = re.compile("[0-9.]+")
# Linux says when a peer has ended its direction; elsewhere such a peer counts as present.
_HALF_CLOSED = getattr(select, "POLLRDHUP", 0)
_EVENTS = select.POLLIN | _HALF_CLOSED
# Without a free descriptor a connection waits in the backlog; an immediate retry would fail again
# and only burn processor time.
_ACCEPT_RETRY_S = 1.0
# In a storm, so that many connections cost one turn of the loop; the backlog holds them so long.
_STORM_PAUSE_S = 0.02
CHECK_INTERVAL_S = 0.25
# After the end of a connection, so that many that end together cost one turn.
_TRIM_DELAY_S = 2.0
# A peer whose machine or network is gone is noticed within 30 + 3 * 10 s.
_KEEPALIVE_OPTIONS = {"TCP_KEEPIDLE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3}
# A host that vanished is disconnected after this time, with or without bytes on their way;
# so is a client whose buffers stay full. The kernel of a busy program replies by itself.
_VANISHED_AFTER_S = int(MAX_BLOCKED_S)
_VANISHED_OPTIONS = {
    "TCP_KEEPIDLE": _VANISHED_AFTER_S // 3,
    "TCP_KEEPINTVL": _VANISHED_AFTER_S // 3,
    "TCP_KEEPCNT": 2,
    "TCP_USER_TIMEOUT": 1000 * _VANISHED_AFTER_S,
}


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of the connections to one port."""

    max_connections: int = MAX_CONNECTIONS
    """Concurrent connections, as in UDK."""
    max_per_address: int = MAX_PER_ADDRESS
    """Those of one address that is not of this machine."""
    handshake_timeout_s: float = 0.0
    """Time for the first valid input; 0 = no limit."""
    idle_timeout_s: float = 0.0
    """Silence of a peer, unless the handler allows more; 0 = no limit."""
    loop_share: LoopShare = field(default_factory=LoopShare)
    """Time of the event loop for the peers' input; one for all ports of a server."""


class Connection(Protocol):
    """What a port knows of a connection, whatever the protocol."""

    address: str
    """Host and port of the peer."""
    opened_at_s: float
    """Time of the connection, on the loop's clock."""

    @property
    def has_handshake(self) -> bool:
        """Whether the peer has sent something valid."""

    @property
    def has_left(self) -> bool:
        """Whether the peer sends nothing more."""

    @property
    def is_in_use(self) -> bool:
        """Whether the connection has a robot, or watches one."""

    def end(self) -> None:
        """Close the connection at once."""


_ConnectionT = TypeVar("_ConnectionT", bound=Connection)


class Port(Generic[_ConnectionT]):
    """The connections of a listening socket, from their acceptance to `remove`."""

    def __init__(
        self,
        listener: Listener,
        open_connection: Callable[[socket.socket, str], _ConnectionT],
        *,
        name: str,
        limits: ConnectionLimits,
        first_bytes: re.Pattern[bytes] = _ANY_BYTES,
        check: Callable[[_ConnectionT, float], str] = lambda connection, now_s: "",
    ) -> None:
        """Begin to accept; to be called from the event loop.

        Args:
            listener: Listening socket, which the port owns from now on.
            open_connection: Makes the connection of an accepted socket and the peer's address; an
                OSError closes the socket and is logged.
            name: Name of the port in the log.
            limits: Number of connections, and the time for their first valid input.
            first_bytes: Matches the first bytes of a client, even of a part of them; connections
                with others come last in a storm.
            check: Called regularly with each connection and the loop's time: the reason to end
                the connection; empty for none.
        """
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._open_connection = open_connection
        self._name = name
        self._limits = limits
        self._check = check
        # In the order of acceptance.
        self._connections: dict[_ConnectionT, None] = {}
        self._waiting = _WaitingSockets(first_bytes)
        self._num_failures = 0
        # Connections that may be opened at once, at a time of the loop's clock.
        self._num_free = float(MAX_BURST)
        self._counted_at_s = self._loop.time()
        self._opening: asyncio.TimerHandle | None = None
        self._trimming: asyncio.TimerHandle | None = None
        self._checking = self._loop.call_later(CHECK_INTERVAL_S, self._check_connections)
        self._listen()

    @property
    def number(self) -> int:
        """TCP port of the listening socket."""
        number: int = self._listener.getsockname()[1]
        return number

    def __len__(self) -> int:
        """Number of connections."""
        return len(self._connections)

    def __iter__(self) -> Iterator[_ConnectionT]:
        """Connections at present, in the order of acceptance."""
        return iter(tuple(self._connections))

    def close(self) -> None:
        """Release the port; accepted connections stay open."""
        if self._listener.fileno() < 0:
            return
        self._loop.remove_reader(self._listener)
        self._listener.close()
        self._checking.cancel()
        if self._trimming is not None:
            self._trimming.cancel()
        if self._opening is not None:
            self._opening.cancel()
        self._waiting.close()

    def remove(self, connection: _ConnectionT) -> None:
        """Forget a connection that has ended."""
        self._connections.pop(connection, None)
        if self._trimming is None and self._listener.fileno() >= 0:
            self._trimming = self._loop.call_later(_TRIM_DELAY_S, self._release_memory)

    def _release_memory(self) -> None:
        """Give back what ended connections held: frames, buffers and variants of cameras."""
        self._trimming = None
        # In a thread: it takes up to 9 ms, without the interpreter.
        self._loop.run_in_executor(None, release_freed_memory)

    def _listen(self) -> None:
        # The socket may have been closed while a retry was pending.
        if self._listener.fileno() >= 0:
            self._loop.add_reader(self._listener, self._accept_waiting)

    def _accept_waiting(self) -> None:
        pause_s = 0.0
        for _ in range(_MAX_ACCEPTS_PER_TURN):
            try:
                accepted, address = self._listener.accept()
            # None left, or the peer has disconnected between the event and this call.
            except (BlockingIOError, ConnectionAbortedError):
                break
            except OSError as error:
                self._log_failure(error)
                pause_s = _ACCEPT_RETRY_S
                break
            accepted.setblocking(False)
            self._waiting.add(accepted, "{}:{}".format(*address[:2]))
        self._open_waiting()
        if self._waiting:
            pause_s = pause_s or _STORM_PAUSE_S
        if pause_s:
            self._loop.remove_reader(self._listener)
            self._loop.call_later(pause_s, self._listen)

    def _open_waiting(self) -> None:
        """Open connections as far as their rate allows: those first whose peer has sent bytes."""
        if self._opening is not None:
            self._opening.cancel()
            self._opening = None
        self._count_free()
        self._waiting.sort()
        while self._num_free >= 1.0 and (waiting := self._waiting.take()) is not None:
            self._num_free -= 1.0
            self._open(*waiting)
        if self._waiting:
            pause_s = (1.0 - self._num_free) / MAX_OPENED_PER_S
            self._opening = self._loop.call_later(max(0.0, pause_s), self._open_waiting)

    def _count_free(self) -> None:
        """Count how many connections may be opened now."""
        now_s = self._loop.time()
        earned = MAX_OPENED_PER_S * (now_s - self._counted_at_s)
        self._num_free = min(self._num_free + earned, float(MAX_BURST))
        self._counted_at_s = now_s

    def _open(self, accepted: socket.socket, address: str) -> None:
        try:
            _set_options(accepted)
            self._make_room(address)
            self._connections[self._open_connection(accepted, address)] = None
        except OSError as error:
            log.warning("connection of %s to the %s port closed: %s", address, self._name, error)
            accepted.close()

    def _make_room(self, address: str) -> None:
        """End a connection where a newcomer finds no place.

        Raises:
            ConnectionRefusedError: All have a robot or watch one.
        """
        host = find_shared_address(address)
        if host is not None:
            of_host = [one for one in self if find_shared_address(one.address) == host]
            if len(of_host) >= self._limits.max_per_address:
                limit = f"the limit of {len(of_host)} connections of one address is reached"
                self._free_place(of_host, limit)
        if len(self._connections) >= self._limits.max_connections:
            limit = f"the limit of {self._limits.max_connections} connections is reached"
            self._free_place(list(self), limit)

    def _free_place(self, candidates: list[_ConnectionT], limit: str) -> None:
        opened_before_s = self._loop.time() - NEWCOMER_AGE_S
        left = [one for one in candidates if one.has_left]
        unused = [one for one in candidates if not one.is_in_use]
        old = [one for one in unused if one.opened_at_s < opened_before_s]
        silent = [one for one in unused if one not in old and not one.has_handshake]
        # The last quarter is for newcomers, of which those without a word make room for others.
        is_crowded = 4 * len(old) > 3 * self._limits.max_connections
        ended = min(
            left or (old if is_crowded or not silent else silent),
            key=lambda one: (one.has_handshake, one.opened_at_s),
            default=None,
        )
        if ended is None:
            raise ConnectionRefusedError(limit)
        log.info("%s closed for a newcomer to the %s port: %s", ended.address, self._name, limit)
        # At once, not when asyncio reports the end: the newcomer takes its place.
        self.remove(ended)
        ended.end()

    def _check_connections(self) -> None:
        """End connections that are overdue."""
        self._checking = self._loop.call_later(CHECK_INTERVAL_S, self._check_connections)
        now_s, limit_s = self._loop.time(), self._limits.handshake_timeout_s
        for connection in self:
            reason = self._check(connection, now_s)
            if (
                limit_s
                and not connection.has_handshake
                and connection.opened_at_s < now_s - limit_s
            ):
                reason = f"nothing valid within {limit_s:g} s"
            if reason:
                log.info("%s disconnected: %s", connection.address, reason)
                connection.end()

    def _log_failure(self, error: OSError) -> None:
        self._num_failures += 1
        log.warning(
            "the %s port accepts no connection for %g s (%d times so far): %s",
            *(self._name, _ACCEPT_RETRY_S, self._num_failures, error.strerror),
        )


class _WaitingSockets:
    """Accepted sockets that wait to be opened, in three queues.

    First come those whose first bytes suit the port, then silent ones, then those with other bytes
    and those whose peer sends nothing more: in a storm of connections that request a picture and
    leave at once, all places were theirs, and newcomers were closed.

    One call of the system asks for all that are silent: with one for each socket there were 9 000 a
    second, and each lets the other threads have the interpreter.
    """

    def __init__(self, first_bytes: re.Pattern[bytes]) -> None:
        self._first_bytes = first_bytes
        self._poller = select.poll()
        # By descriptor, as the poller names them.
        self._silent: dict[int, _WaitingSocket] = {}
        self._suitable: deque[_WaitingSocket] = deque()
        self._others: deque[_WaitingSocket] = deque()

    def __len__(self) -> int:
        return len(self._silent) + len(self._suitable) + len(self._others)

    def add(self, accepted: socket.socket, address: str) -> None:
        """Have a socket wait."""
        self._silent[accepted.fileno()] = accepted, address
        self._poller.register(accepted, _EVENTS)

    def sort(self) -> None:
        """Move those with bytes; close those whose connection has ended, and those too many."""
        for descriptor, events in self._poller.poll(0):
            waiting = self._pop_silent(descriptor)
            first = _peek(waiting[0])
            if not first:
                waiting[0].close()
            elif events & _HALF_CLOSED or not self._first_bytes.match(first):
                self._others.append(waiting)
            else:
                self._suitable.append(waiting)
        # The oldest: a newcomer may be about to send its first bytes.
        while len(self) > _MAX_WAITING:
            if self._others:
                self._others.popleft()[0].close()
            elif self._silent:
                self._pop_silent(next(iter(self._silent)))[0].close()
            else:
                self._suitable.popleft()[0].close()

    def take(self) -> _WaitingSocket | None:
        """Take the next one; None if none is left."""
        while self._suitable:
            waiting = self._suitable.popleft()
            if not _has_left(waiting[0]):
                return waiting
            self._others.append(waiting)
        if self._silent:
            return self._pop_silent(next(iter(self._silent)))
        while self._others:
            waiting = self._others.popleft()
            if _peek(waiting[0]):
                return waiting
            waiting[0].close()
        return None

    def close(self) -> None:
        """Close all."""
        for accepted, _ in (*self._silent.values(), *self._suitable, *self._others):
            accepted.close()

    def _pop_silent(self, descriptor: int) -> _WaitingSocket:
        self._poller.unregister(descriptor)
        return self._silent.pop(descriptor)


def _peek(accepted: socket.socket) -> bytes:
    """First bytes that a peer has sent; empty if it has left without any."""
    try:
        return accepted.recv(_MAX_FIRST_BYTES, socket.MSG_PEEK)
    except OSError:
        return b""


def _has_left(accepted: socket.socket) -> bool:
    """Whether a peer has closed its connection, or ended the direction to the server."""
    poller = select.poll()
    poller.register(accepted, _HALF_CLOSED)
    return bool(poller.poll(0))


async def warn_of_exposure(host: str) -> None:
    """Log a warning if other machines can reach the ports of a host name or address."""
    try:
        reachable = [a for a in await _resolve(host) if not ip_address(a).is_loopback]
    except (OSError, UnicodeError):
        # UnicodeError: an impossible name, such as a..b. Opening the ports fails too, and ends the
        # server with the reason.
        return
    if reachable:
        log.warning(
            "the ports are open to the network on %s, without authentication, except for the live "
            "page, whose link has a token: every machine that reaches them can drive the robots "
            "and see their cameras. Restrict them by a firewall, "
            "or serve on 127.0.0.1 and connect through `ssh -L`",
            ", ".join(reachable),
        )


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
            _prepare_host(host), port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
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


def _prepare_host(host: str) -> str | bytes | None:
    """Host as `getaddrinfo` takes it: for text it loads the codec of international names."""
    return host.encode() if _IPV4_ADDRESS.fullmatch(host) else host or None


async def _resolve(host: str) -> list[str]:
    """Addresses of a host, without the scope of link-local ones; of "" the wildcard."""
    found = await asyncio.get_running_loop().getaddrinfo(
        _prepare_host(host), 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )
    return sorted({str(address[0]).partition("%")[0] for *_, address in found})


def _set_options(end: socket.socket) -> None:
    # A reply must not wait for the acknowledgement of the one before. asyncio sets this only on
    # sockets whose protocol number is stated, as `accept` does not.
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
