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

    def __len__(self) -> int:
        """Number of items."""
        return len(self._items)

    def get(self, key: K) -> V | None:
        """Item of a key, which does not count as a use."""
        return self._items.get(key)

    def get_or_make(self, key: K, make: Callable[[], V]) -> V:
        """Item of a key, made by a function if there is none."""
        # Removed and inserted again: dicts keep the order of insertion.
        item = self._items.pop(key, None)
        if item is None:
            item = make()
        self._items[key] = item
        while len(self._items) > self._max_items:
            self.remove(next(iter(self._items)))
        return item

    def put(self, key: K, item: V) -> None:
        """Set the item of a key, in place of another one; `on_remove` is not called for that."""
        self._items.pop(key, None)
        self.get_or_make(key, lambda: item)

    def remove(self, key: K) -> None:
        """Remove the item of a key."""
        del self._items[key]
        self._on_remove(key)

    def clear(self) -> None:
        """Remove all items."""
        for key in self.keys():
            self.remove(key)

    def keys(self) -> tuple[K, ...]:
        """Keys, the one used longest ago first."""
        return tuple(self._items)
