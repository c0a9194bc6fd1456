"""Limits of what clients together may take of the server, for all ports alike.

* **Connections**: how many a port has, and how many of them one address; `port.py` decides who
  makes room. Descriptors of open files are shared out in advance: connections to one port never
  take those of another.
* **Time of the event loop**, as measured: the loop, the simulation and the renderer's threads share
  one interpreter, and a frame that takes 26 ms alone took 200 ms while floods kept the loop busy.
  Input that nobody waits for, such as a flood of commands, has a tenth of the loop's time, a
  dialogue six tenths. While all together stay below, nobody waits. Above, only those wait that
  have used more than an equal part: a viewer loses nothing to a flood, and 64 viewers of a small
  camera do not starve each other while the loop idles.
* **Calls of other threads come in bundles.** Each `call_soon_threadsafe` writes to a pipe: some 400
  a second were a fifth of the simulation's time under load.
"""

from __future__ import annotations

import asyncio
import logging
import math
import resource
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from weakref import WeakValueDictionary

from catoptra_protocol.limits import MAX_REQUEST_BYTES

log = logging.getLogger(__name__)

# Connections: of control port and image port each, 64 as in UDK; of one address that is not of
# this machine; of the stream, all clients and some more, which get an error in reply; of the page,
# two WebSockets each and six at most while one loads files.
MAX_CONNECTIONS = 64
MAX_PER_ADDRESS = 16
MAX_STREAM_CONNECTIONS = 288
# Of the stream: the client's socket, and two ends of the local one.
DESCRIPTORS_PER_CONNECTION = 3
MAX_PAGE_CONNECTIONS = 128
# Each client of the stream may have a robot.
MAX_PEERS = 256
# Age up to which a connection without a robot has a place of the quarter that is kept for others;
# likewise the time for which a connection counts as watching after a request.
NEWCOMER_AGE_S = 10.0
# Connections opened at once, and per second.
MAX_BURST = 64
MAX_OPENED_PER_S = 20.0
# Requests of a client without a reply: more than any program has on its way that waits for them.
MAX_PENDING = 64
# Parts of a message: a request is one; with a few more the client gets an error in words, which
# helps the author.
MAX_PARTS = 8
# Unsent lines of a controller: above the first, periodic reports are dropped, above the second
# (queries without reading the replies) the client is disconnected, so that memory stays bounded.
DROP_PERIODIC_ABOVE_BYTES = 64 * 1024
DISCONNECT_ABOVE_BYTES = 1024 * 1024
# Unsent replies of a client of the stream: twice the pending requests, a program that reads at all
# stays far below; bytes of all but the frame, eight of the largest replies.
MAX_UNSENT_MESSAGES = 128
MAX_UNSENT_BYTES = 4 * 1024 * 1024
# A client that reads nothing for so long is not a busy program: ZeroMQ reads for that one, until
# its queue is full. A host that vanished is disconnected after the same time.
MAX_BLOCKED_S = 6.0
# An idle server has 66 descriptors open; the rest is for files and libraries of a late moment.
_RESERVED_DESCRIPTORS = 100
# Parts of the loop's time for the input of all clients together. While the loop runs, the threads
# that simulate and render wait for the interpreter: with 0.3 for floods on each of three ports a
# frame took 200 ms instead of 26 under attack.
_FLOOD_SHARE = 0.1
_DIALOGUE_SHARE = 0.6
# Time over which use is averaged: a burst of a tenth of this costs nobody anything.
_MEMORY_S = 1.0
# Age at which the equal part is determined anew: for 300 clients that takes 0.1 ms.
_LEVEL_AGE_S = 0.05
# Longest wait after one read.
_MAX_WAIT_S = 1.0


def limits_table() -> str:
    """Table of SPEC 9.8, in Markdown."""
    kib = 1024
    rows = (
        ("connections to control port and image port, each", MAX_CONNECTIONS),
        ("connections to the stream; clients among them", f"{MAX_STREAM_CONNECTIONS}; {MAX_PEERS}"),
        ("connections to the page's port", MAX_PAGE_CONNECTIONS),
        ("of these, of one address that is not of this machine", MAX_PER_ADDRESS),
        ("connections opened at once; then per second", f"{MAX_BURST}; {MAX_OPENED_PER_S:g}"),
        ("age of a newcomer, and of the last request of a viewer", f"{NEWCOMER_AGE_S:g} s"),
        ("commands or requests of a client that wait", MAX_PENDING),
        ("bytes of a request; parts of a message", f"{MAX_REQUEST_BYTES // kib} KiB; {MAX_PARTS}"),
        ("unsent lines of a controller: periodic reports are dropped",
         f"{DROP_PERIODIC_ABOVE_BYTES // kib} KiB"),
        ("unsent lines of a controller: it is disconnected",
         f"{DISCONNECT_ABOVE_BYTES // kib} KiB"),
        ("unsent replies of the stream, and their bytes; beside one frame",
         f"{MAX_UNSENT_MESSAGES}; {MAX_UNSENT_BYTES // kib} KiB"),
        ("time in which a client reads nothing of what waits", f"{MAX_BLOCKED_S:g} s"),
        ("time of the server's messages for floods; for clients that wait for each reply",
         f"{_FLOOD_SHARE:.0%}; {_DIALOGUE_SHARE:.0%}"),
    )  # fmt: skip
    lines = ["| limit | value |", "|---|---|", *(f"| {what} | {value} |" for what, value in rows)]
    return "\n".join(lines)


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


def find_shared_address(address: str) -> str | None:
    """Address that several connections share; None on the loopback, where each has an account.

    Args:
        address: Host and port of a peer, such as 192.0.2.7:40000 or ::1:40000.
    """
    host = address.rpartition(":")[0].partition("%")[0]
    # A socket of both families has IPv4 peers as ::ffff:127.0.0.1, which is no loopback itself.
    found = ip_address(host)
    found = getattr(found, "ipv4_mapped", None) or found
    return None if found.is_loopback else str(found)


class LoopShare:
    """Time of the event loop for the input of clients, divided among those that use it."""

    def __init__(
        self,
        flood_share: float = _FLOOD_SHARE,
        dialogue_share: float = _DIALOGUE_SHARE,
        *,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create a share without clients.

        Args:
            flood_share: Part of the loop's time, 0 to 1, for input that nobody waits for.
            dialogue_share: The same for clients that wait for each reply.
            monotonic: Clock, seconds.
        """
        # A flood is held back even where it is alone: its time is taken from frames.
        self._floods = _MeasuredShare(flood_share, monotonic, min_clients=1)
        self._dialogues = _MeasuredShare(dialogue_share, monotonic, min_clients=2)
        # Weak: connections hold their account.
        self._of_address: WeakValueDictionary[str, LoopAccount] = WeakValueDictionary()

    def open_account(self, address: str = "", *, max_wait_s: float = _MAX_WAIT_S) -> LoopAccount:
        """Account of a new connection; one for all connections of another machine.

        Args:
            address: Host and port of the peer; empty for an account of its own.
            max_wait_s: Longest wait after one read.
        """
        host = find_shared_address(address) if address else None
        account = self._of_address.get(host) if host else None
        if account is None:
            account = LoopAccount(self._floods, self._dialogues, max_wait_s)
            if host:
                self._of_address[host] = account
        return account


class LoopAccount:
    """Use of the loop by one client."""

    def __init__(
        self, floods: _MeasuredShare, dialogues: _MeasuredShare, max_wait_s: float
    ) -> None:
        self._floods = floods
        self._dialogues = dialogues
        self._max_wait_s = max_wait_s

    def charge(self, duration_s: float, *, is_dialogue: bool = False) -> None:
        """Record that the client's input took some time of the loop.

        Args:
            duration_s: Processor time of the loop's thread: with wall time the client would pay
                for other threads, too.
            is_dialogue: Whether the client waits for the reply: then there is one command at any
                time, and waiting would slow it down, by half under lockstep.
        """
        (self._dialogues if is_dialogue else self._floods).charge(self, duration_s)

    @contextmanager
    def charge_block(self, *, is_dialogue: bool = False) -> Iterator[None]:
        """Charge the processor time of a block, which does not await, to the client."""
        begin_s = time.thread_time()
        yield
        self.charge(time.thread_time() - begin_s, is_dialogue=is_dialogue)

    @property
    def remaining_wait_s(self) -> float:
        """Time until the client may be read again; 0 for now."""
        wait_s = max(self._floods.find_wait_s(self), self._dialogues.find_wait_s(self))
        return min(wait_s, self._max_wait_s)

    async def wait(self) -> None:
        """Wait until the client may use the loop again; mostly not at all."""
        wait_s = self.remaining_wait_s
        if wait_s > 0.0:
            await asyncio.sleep(wait_s)


class _MeasuredShare:
    """A part of the loop's time, and what each client has used of it in the last second."""

    def __init__(self, share: float, monotonic: Callable[[], float], *, min_clients: int) -> None:
        self._capacity_s = share * _MEMORY_S
        self._min_clients = min_clients
        self._monotonic = monotonic
        # Use of a client at a time, from which on it decays.
        self._used: dict[LoopAccount, tuple[float, float]] = {}
        self._level_s = math.inf
        self._level_at_s = -math.inf

    def charge(self, account: LoopAccount, duration_s: float) -> None:
        """Add to the use of a client."""
        now_s = self._monotonic()
        self._used[account] = self._find_use_s(account, now_s) + duration_s, now_s
        if now_s - self._level_at_s > _LEVEL_AGE_S:
            self._find_level(now_s)

    def find_wait_s(self, account: LoopAccount) -> float:
        """Time until a client has used no more than an equal part; 0 while there is enough."""
        now_s = self._monotonic()
        if account not in self._used:
            return 0.0
        if now_s - self._level_at_s > _LEVEL_AGE_S:
            self._find_level(now_s)
        used_s = self._find_use_s(account, now_s)
        return _MEMORY_S * math.log(used_s / self._level_s) if used_s > self._level_s else 0.0

    def _find_use_s(self, account: LoopAccount, now_s: float) -> float:
        used_s, at_s = self._used.get(account, (0.0, now_s))
        return used_s * math.exp((at_s - now_s) / _MEMORY_S)

    def _find_level(self, now_s: float) -> None:
        """Determine the use above which clients wait: with it all together use the capacity."""
        used = {one: self._find_use_s(one, now_s) for one in self._used}
        # Below a microsecond a client is forgotten: its connection may have ended.
        self._used = {one: (use_s, now_s) for one, use_s in used.items() if use_s > 1e-6}
        self._level_s, self._level_at_s = math.inf, now_s
        if len(used) < self._min_clients:
            return
        left_s = self._capacity_s
        for index, use_s in enumerate(sorted(used.values())):
            level_s = left_s / (len(used) - index)
            if use_s > level_s:
                self._level_s = level_s
                return
            left_s -= use_s


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
