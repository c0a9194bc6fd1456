"""Entries of one section of an ini file, and which of their keys were read."""

from __future__ import annotations

from collections.abc import Iterable

from catoptra_server.config.entry_list import EntryList
from catoptra_server.config.unknown_names import UnknownName, suggest_name
from catoptra_server.config.unreal_ini import Entry

# A key that was not read so far may be read later: WheelBase is no misspelt WheelRadius.
_MIN_SIMILARITY = 0.75


class SectionEntries:
    """Entries by key in any case, in the order of the file."""

    def __init__(self, entries: Iterable[Entry]) -> None:
        # The lines as written: a derived section is replayed line by line over its base, operators
        # included, which the resulting values alone would no longer show.
        self._lines: list[Entry] = []
        self._entries: dict[str, EntryList] = {}
        # As readers spell them, by lower-case key.
        self._used_keys: dict[str, str] = {}
        for entry in entries:
            self.apply(entry)

    def apply(self, entry: Entry) -> None:
        """Apply a line: a repeated key and . append, + appends if new, - removes, ! clears."""
        self._lines.append(entry)
        self._entries.setdefault(entry.key.lower(), EntryList()).apply(entry)

    def apply_overrides(self, derived: SectionEntries) -> None:
        """Apply a derived section: plain keys replace this one's, + . - ! lines modify them."""
        changed: set[str] = set()
        for entry in derived._lines:
            key = entry.key.lower()
            # Only the first plain line of a key clears the base's list; the next ones extend it.
            if key not in changed and not entry.operator:
                self._entries.pop(key, None)
            changed.add(key)
            self.apply(entry)

    def has_key(self, key: str) -> bool:
        """Whether the key has a value; does not count as reading the key."""
        return bool(self._entries.get(key.lower()))

    def use(self, key: str) -> EntryList:
        """Entries of a key, which counts as read; empty for a missing one."""
        self._used_keys[key.lower()] = key
        return self._entries.get(key.lower(), EntryList())

    @property
    def is_used(self) -> bool:
        """Whether any key was read."""
        return bool(self._used_keys)

    def ignore_all(self) -> None:
        """Count every key as read."""
        self._used_keys.update({key: key for key in self._entries})

    def unread_names(self, section: str) -> list[UnknownName]:
        """Entries whose keys were not read, as unknown names of a section."""
        known = self._used_keys.values()
        return [
            UnknownName(
                entry.key, entry.value, entry.where, section, suggest_name(entry.key, known)
            )
            for key, entries in self._entries.items()
            if key not in self._used_keys
            for entry in entries
        ]

    def find_misspelt(self, key: str) -> str:
        """Unread key, as the file spells it, that may have been meant to be a missing one."""
        unread = [k for k in self._entries if k not in self._used_keys]
        misspelt = suggest_name(key, unread, _MIN_SIMILARITY)
        return self._entries[misspelt].last.key if misspelt else ""
