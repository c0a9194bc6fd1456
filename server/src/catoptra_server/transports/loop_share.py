"""Limit of the event loop's time that clients may use for their input.

A connection that has used its part is not read for a while: TCP holds its sender back, and the loop
is free for the other connections.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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
        """Forget the use of a connection that sends its commands one by one.

        A dialogue, in which the peer waits for each reply, needs no limit: at any time it occupies
        the loop with one command. It would be the slower for a limit, by half under lockstep.
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
