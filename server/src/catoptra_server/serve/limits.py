"""What clients together may take of the server: connections, their acceptance, time of the loop.

* **A tenth of the event loop for input.** All connections together may use a tenth of the loop's
  time for their input, in equal parts for those in use. A connection that has used its part is not
  read for a while: TCP holds the sender back. The loop, the simulation and the renderer's threads
  share one interpreter, and a frame that takes 26 ms alone took 200 ms while floods kept the loop
  busy. A client that waits for each reply is not limited, nor is a page with three requests
  pending.
* **Calls of other threads come in bundles.** Each `call_soon_threadsafe` writes to a pipe: some 400
  a second were a fifth of the simulation's time under load.
* **Sockets are accepted here**, since asyncio's own servers log a traceback for each failed
  `accept`, without a pause: 27 000 in a minute without free descriptors.
* **Descriptors of open files are shared out in advance**: connections to one port never take those
  of another.
"""

from __future__ import annotations

import asyncio
import logging
import os
import resource
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address

log = logging.getLogger(__name__)
# Connections that the kernel completes before they are accepted, six seconds at the rate below. One
# that does not fit is tried again by the peer's kernel after a second.
BACKLOG = 128
Listener = socket.socket
# Receives an accepted socket and the address of the peer. An OSError closes the socket.
_AcceptCallback = Callable[[socket.socket, str], None]
# An idle server has 66 descriptors open; the rest is for files and libraries of a late moment.
_RESERVED_DESCRIPTORS = 100
# Part of the loop's time for input of all connections together. While the loop runs, the threads
# that simulate and render wait for the interpreter: with 0.3 for each of three ports a frame took
# 200 ms instead of 26 under attack.
_SHARE = 0.1
# Wait below which a connection is read at once: single commands, 0.1 ms each, never wait.
_BURST_S = 0.02
# Time of the loop for one read, beside the work that follows: a flood of single bytes costs this.
# Measured for 4 KiB that are discarded, as processor time of the loop's thread.
_READ_S = 0.0003
# Longest wait after one chunk.
_MAX_WAIT_S = 1.0
# Connections accepted in one turn of the loop; the others wait for a later one.
_MAX_ACCEPTS_PER_TURN = 16
# Connections accepted at once, and per second: opening and closing one takes 1 ms of the loop, and
# a flood of 240 a second took half the time. A newcomer waits in the backlog meanwhile.
_MAX_BURST = 64
_MAX_ACCEPTS_PER_S = 20.0
# Without a free descriptor a connection waits in the backlog; an immediate retry would fail again
# and only burn processor time.
_ACCEPT_RETRY_S = 1.0
# A peer whose machine or network is gone is noticed within 30 + 3 * 10 s.
_KEEPALIVE_OPTIONS = {"TCP_KEEPIDLE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3}
# A host that vanished is disconnected after this time, with or without bytes on their way;
# so is a client whose buffers stay full. The kernel of a busy program replies by itself.
_VANISHED_AFTER_S = 6
_VANISHED_OPTIONS = {
    "TCP_KEEPIDLE": _VANISHED_AFTER_S // 3,
    "TCP_KEEPINTVL": _VANISHED_AFTER_S // 3,
    "TCP_KEEPCNT": 2,
    "TCP_USER_TIMEOUT": 1000 * _VANISHED_AFTER_S,
}


def fit_connections(wanted: int, *, share: float, descriptors_each: int = 1, name: str) -> int:
    """Limit of connections to a port: as many as wanted, or as descriptors allow.

    Args:
        wanted: Configured limit.
        share: Part of the descriptors for this port, 0 to 1; the shares of all ports add up to 1.
        descriptors_each: Descriptors of one connection.
        name: Name of the port in the log.
    """
    soft_limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft_limit == resource.RLIM_INFINITY:
        return wanted
    available = share * (soft_limit - _RESERVED_DESCRIPTORS)
    fitting = max(1, int(available / descriptors_each))
    if fitting < wanted:
        log.warning(
            "the %s port has %d connections at most, not %d: the process may open %d files; "
            "raise the limit with `ulimit -n`",
            *(name, fitting, wanted, soft_limit),
        )
    return min(fitting, wanted)


class LoopShare:
    """Time of the loop for the input of some connections, in equal parts for those in use."""

    def __init__(
        self,
        share: float = _SHARE,
        *,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create a share without connections.

        Args:
            share: Part of the loop's time for all connections together, 0 to 1.
            monotonic: Clock, seconds.
        """
        self._share = share
        self._monotonic = monotonic
        self._active: set[LoopAccount] = set()

    def open_account(self, *, max_wait_s: float = _MAX_WAIT_S) -> LoopAccount:
        """Account of a new connection, which waits at most some time after one chunk."""
        return LoopAccount(self, max_wait_s)

    def charge(self, account: LoopAccount, duration_s: float) -> None:
        """Record that the input of a connection took some time; see `LoopAccount.charge`."""
        now_s = self._monotonic()
        self._active = {one for one in self._active if one.paid_at_s > now_s} | {account}
        price_s = duration_s * len(self._active) / self._share
        paid_at_s = max(account.paid_at_s, now_s) + price_s
        account.paid_at_s = min(paid_at_s, now_s + _BURST_S + account.max_wait_s)

    def remaining_wait_s(self, account: LoopAccount) -> float:
        """Time until a connection may be read; 0 or less for now."""
        return account.paid_at_s - _BURST_S - self._monotonic()


class LoopAccount:
    """Use of the loop by one connection."""

    def __init__(self, share: LoopShare, max_wait_s: float) -> None:
        self._share = share
        self.max_wait_s = max_wait_s
        self.paid_at_s = 0.0
        """Time at which all use so far is within the connection's part."""

    def charge(self, duration_s: float) -> None:
        """Record that the connection's input took some time of the loop."""
        self._share.charge(self, duration_s)

    @contextmanager
    def charge_block(self) -> Iterator[None]:
        """Charge the processor time of a block to the connection."""
        # Of this thread: with wall time the connection would pay for other threads, too.
        begin_s = time.thread_time()
        yield
        self.charge(time.thread_time() - begin_s)

    def charge_read(self) -> None:
        """Charge the loop's time for one read to the connection."""
        self.charge(_READ_S)

    def write_off(self) -> None:
        """Forget the use of a connection that sends commands one by one.

        A dialogue, in which the peer waits for each reply, needs no limit: at any time there is one
        command. A limit would slow it down, by half under lockstep.
        """
        self.paid_at_s = 0.0

    @property
    def remaining_wait_s(self) -> float:
        """Time until the connection may be read; 0 or less for now."""
        return self._share.remaining_wait_s(self)

    async def wait(self) -> None:
        """Wait until the connection may use the loop again; mostly not at all."""
        wait_s = self.remaining_wait_s
        if wait_s > 0.0:
            await asyncio.sleep(wait_s)


class LoopCalls:
    """Calls that the event loop executes in the order of `call`."""

    def __init__(self) -> None:
        """Create an empty queue; to be called from the event loop."""
        self._loop = asyncio.get_running_loop()
        self._calls: deque[Callable[[], object]] = deque()
        self._is_scheduled = False

    def call(self, function: Callable[[], object]) -> None:
        """Have the loop call a function soon; from any thread."""
        # Appended before the flag is read, while the loop clears the flag before it looks at the
        # queue: a function is never left behind.
        self._calls.append(function)
        if not self._is_scheduled:
            self._is_scheduled = True
            self._loop.call_soon_threadsafe(self._run)

    def _run(self) -> None:
        self._is_scheduled = False
        # Only the functions so far: others of the loop's callbacks come between.
        for _ in range(len(self._calls)):
            # By the loop itself, which reports an exception and goes on with the next.
            self._loop.call_soon(self._calls.popleft())


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
    """Hands over the connections of a listening socket, which `close` ends."""

    def __init__(self, listener: socket.socket, accept: _AcceptCallback, *, name: str) -> None:
        """Begin to accept; to be called from the event loop.

        Args:
            listener: Listening socket, which the loop owns from now on.
            accept: Receives each connection; an OSError closes the connection and is logged.
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


async def _resolve(host: str) -> list[str]:
    """Addresses of a host, without the scope of link-local ones; of "" the wildcard."""
    found = await asyncio.get_running_loop().getaddrinfo(
        host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
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
