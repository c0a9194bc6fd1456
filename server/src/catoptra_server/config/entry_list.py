"""Values of one key of an ini section, in the order of the file."""

from __future__ import annotations

from collections.abc import Iterator

from catoptra_server.config.unreal_ini import Entry


class EntryList:
    """Entries of one key, found and removed by value in constant time.

    A plain list would be searched for each + and - line: 40 000 of them took a minute.
    """

    def __init__(self) -> None:
        # Numbered as added: removal leaves the order of the others.
        self._entries: dict[int, Entry] = {}
        self._numbers: dict[str, list[int]] = {}
        self._num_added = 0

    def __len__(self) -> int:
        """Number of entries."""
        return len(self._entries)

    def __iter__(self) -> Iterator[Entry]:
        """Iterate in the order of the file."""
        return iter(self._entries.values())

    @property
    def last(self) -> Entry:
        """Last entry; the list must not be empty."""
        return next(reversed(self._entries.values()))

    def apply(self, entry: Entry) -> None:
        """Apply a line: plain and . append, + appends if new, - removes, ! clears."""
        match entry.operator:
            case "!":
                self._entries.clear()
                self._numbers.clear()
            case "-":
                for number in self._numbers.pop(entry.value, ()):
                    del self._entries[number]
            case "+" if entry.value in self._numbers:
                pass
            case _:
                self._append(entry)

    def _append(self, entry: Entry) -> None:
        self._numbers.setdefault(entry.value, []).append(self._num_added)
        self._entries[self._num_added] = entry
        self._num_added += 1
