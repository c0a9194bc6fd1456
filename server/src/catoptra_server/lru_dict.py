"""Dictionary of a limited number of items, without the one used longest ago."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

K = TypeVar("K")
V = TypeVar("V")


class LruDict(Generic[K, V]):
    """Items by key, each made at its first use; no item is None."""

    def __init__(
        self, max_items: int, *, on_remove: Callable[[K], None] = lambda key: None
    ) -> None:
        """Create an empty dictionary.

        Args:
            max_items: Number of items above which the one used longest ago is removed.
            on_remove: Receives the key of each item that is removed.
        """
        self._max_items = max_items
        self._on_remove = on_remove
        self._items: dict[K, V] = {}  # the last used at the end
        self._newest: tuple[K, V] | None = None

    def __len__(self) -> int:
        """Number of items."""
        return len(self._items)

    def get(self, key: K) -> V | None:
        """Item of a key, which does not count as a use."""
        newest = self._newest
        return newest[1] if newest is not None and newest[0] is key else self._items.get(key)

    def get_or_make(self, key: K, make: Callable[[], V]) -> V:
        """Item of a key, made by a function if there is none."""
        # By identity first: hashing a camera takes 10 microseconds, and all else of a look-up one.
        newest = self._newest
        if newest is not None and newest[0] is key:
            return newest[1]
        # Removed and inserted again: dicts keep the order of insertion.
        item = self._items.pop(key, None)
        if item is None:
            item = make()
        self._items[key] = item
        self._newest = key, item
        while len(self._items) > self._max_items:
            self.remove(next(iter(self._items)))
        return item

    def put(self, key: K, item: V) -> None:
        """Set the item of a key, in place of another one; `on_remove` is not called for that."""
        self._newest = None
        self._items.pop(key, None)
        self.get_or_make(key, lambda: item)

    def remove(self, key: K) -> None:
        """Remove the item of a key."""
        self._newest = None
        del self._items[key]
        self._on_remove(key)

    def clear(self) -> None:
        """Remove all items."""
        for key in self.keys():
            self.remove(key)

    def keys(self) -> tuple[K, ...]:
        """Keys, the one used longest ago first."""
        return tuple(self._items)
