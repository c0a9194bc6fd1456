"""Work of many clients in one queue, ordered so that heavy use of one delays no other.

Within a share of the time that a client may use, work is taken in the order of arrival. Work of
clients above their share waits behind all other work, the least used client first. One queue in the
order of arrival let four seconds of one client's scans stop the reports of all for sixteen.

Use is forgotten within seconds. Without that, clients that together use all the time owe more and
more, and a newcomer comes before them until it owes as much: viewers of twenty seconds stood still
for five, each time that somebody connected.

Long work of a client above its share leaves time to others even while none of theirs waits, if some
did a moment ago: otherwise it would begin between two requests of a viewer that requests frame
after frame. Without a share the order of arrival decides alone, as lockstep needs it.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable
from dataclasses import field
from typing import Generic, TypeVar

from catoptra_protocol.slotted_dataclass import dataclass

_Key = TypeVar("_Key", bound=Hashable)
_Item = TypeVar("_Item")

# Use that a client may have at once before its work waits behind the others'.
_BURST_S = 0.005
# Time within which use is forgotten but for a third, and below which an account says nothing.
_MEMORY_S = 1.0
_NO_USE_S = 1e-6
# Time that long work leaves to others, as a multiple of its last duration.
_PAUSE_OF_LONG_WORK = 4.0
# Idle accounts above which those without use are removed: keys such as names of channels come
# from clients, and are not removed by anyone else.
_MAX_IDLE_ACCOUNTS = 256


@dataclass(slots=True, eq=False)
class _Account(Generic[_Item]):
    """Waiting work of one client, and its use of the time above its share."""

    items: deque[tuple[int, _Item]] = field(default_factory=deque)
    """Work with the number of its arrival."""
    used_s: float = 0.0
    last_s: float = 0.0
    """Duration of the last item."""
    updated_s: float = -math.inf
    """Time of the last charge."""


class FairQueue(Generic[_Key, _Item]):
    """A queue by client. Not thread-safe: the owner holds a lock."""

    def __init__(
        self,
        *,
        share: float | None,
        patience_s: float = 0.0,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create an empty queue.

        Args:
            share: Part of the time, 0 to 1, that a client may use before its work waits behind
                the others'; None keeps the order of arrival whatever is used.
            patience_s: Age of the last work of a client with less use up to which long work waits
                for the next; work is long from this duration on. 0 waits for nobody.
            monotonic: Clock, seconds.
        """
        self._share = share
        self._patience_s = patience_s
        self._monotonic = monotonic
        self._accounts: dict[_Key, _Account[_Item]] = {}
        self._num_waiting = 0
        self._num_arrived = 0

    def __len__(self) -> int:
        """Number of waiting items."""
        return self._num_waiting

    @property
    def num_arrived(self) -> int:
        """Number of all items so far, taken and dropped ones included."""
        return self._num_arrived

    def count(self, key: _Key) -> int:
        """Number of waiting items of a client."""
        account = self._accounts.get(key)
        return len(account.items) if account else 0

    def newest(self, key: _Key) -> _Item | None:
        """Newest waiting item of a client."""
        account = self._accounts.get(key)
        return account.items[-1][1] if account and account.items else None

    def find_payer(self, keys: Iterable[_Key]) -> _Key:
        """The client, of some, that has used least; of equal ones, that has least work waiting.

        All have an account from here on, so that each may be charged.
        """
        now_s = self._monotonic()

        def rank(key: _Key) -> tuple[float, int]:
            account = self._accounts.setdefault(key, _Account())
            return self._present_use_s(account, now_s), len(account.items)

        return min(keys, key=rank)

    def put(self, key: _Key, item: _Item) -> None:
        """Append an item to the work of a client."""
        self._num_arrived += 1
        self._num_waiting += 1
        self._accounts.setdefault(key, _Account()).items.append((self._num_arrived, item))

    def replace_newest(self, key: _Key, item: _Item) -> None:
        """Put an item in place of the newest waiting one of a client."""
        items = self._accounts[key].items
        items[-1] = (items[-1][0], item)

    def take(self, *, arrived_by: int | None = None) -> tuple[_Key, _Item] | None:
        """Remove and return the next item with its client; None if none is to be begun now.

        Args:
            arrived_by: Newest arrival to take, see `num_arrived`; None takes any.
        """
        waiting = [(key, account) for key, account in self._accounts.items() if account.items]
        if not waiting:
            return None
        now_s = self._monotonic()
        key, account = min(waiting, key=lambda entry: self._rank(entry[1], now_s))
        if arrived_by is not None and account.items[0][0] > arrived_by:
            return None
        if self._patience_s and self._has_active_rival(account, now_s):
            return None
        self._num_waiting -= 1
        return key, account.items.popleft()[1]

    def charge(self, key: _Key, duration_s: float, *, weight: float = 1.0) -> None:
        """Record that work of a client took some time, which counts by a weight as its use."""
        now_s = self._monotonic()
        account = self._accounts.get(key)
        # A client that has left meanwhile is not held by an account.
        if account is None:
            return
        account.used_s = self._present_use_s(account, now_s) + weight * duration_s
        account.last_s, account.updated_s = duration_s, now_s
        if len(self._accounts) > len(self) + _MAX_IDLE_ACCOUNTS:
            self._remove_idle(now_s)

    def write_off(self, key: _Key) -> None:
        """Forget the time that a client has used."""
        if key in self._accounts:
            self._accounts[key].used_s = 0.0

    def drop(self, key: _Key) -> list[_Item]:
        """Remove a client, and return its waiting items."""
        account = self._accounts.pop(key, None)
        items = [item for _, item in account.items] if account else []
        self._num_waiting -= len(items)
        return items

    def clear(self) -> list[_Item]:
        """Remove all clients, and return all waiting items."""
        return [item for key in list(self._accounts) for item in self.drop(key)]

    def _rank(self, account: _Account[_Item], now_s: float) -> tuple[float, int]:
        used_s = 0.0 if self._share is None else self._present_use_s(account, now_s)
        # Equal for all clients within their share, so that the arrival decides among them.
        allowed_s = max(_BURST_S, (self._share or 0.0) * _MEMORY_S)
        return (used_s if used_s > allowed_s else 0.0, account.items[0][0])

    def _has_active_rival(self, account: _Account[_Item], now_s: float) -> bool:
        """Whether long work of a client waits for a client with less use, active a moment ago."""
        if account.last_s < self._patience_s:
            return False
        # A fifth of the time remains for the long work.
        if now_s - account.updated_s > _PAUSE_OF_LONG_WORK * account.last_s:
            return False
        used_s = self._present_use_s(account, now_s)
        return any(
            now_s - other.updated_s < self._patience_s
            and self._present_use_s(other, now_s) < used_s
            for other in self._accounts.values()
            if other is not account
        )

    def _present_use_s(self, account: _Account[_Item], now_s: float) -> float:
        """Use so far, as far as it is not forgotten."""
        if not account.used_s:
            return 0.0
        return account.used_s * math.exp((account.updated_s - now_s) / _MEMORY_S)

    def _remove_idle(self, now_s: float) -> None:
        """Remove accounts that say nothing: without work, and with all use forgotten."""
        for key, account in list(self._accounts.items()):
            if not account.items and self._present_use_s(account, now_s) < _NO_USE_S:
                del self._accounts[key]
