"""Grammar of Unreal's ini files, as real USARBot.ini and UDK files use it.

`[Package.Class]` sections that may occur twice, `key=value`, the prefixes + . - ! of keys, `;`
comments (whole line or trailing), quoted strings, class'Package.Name' references and nested struct
literals (A=1,B=(X=0)). Also accepted, since real files have them: spaces around =, a stray ; after
a value, text after a struct's closing bracket, missing blank lines, any line end. The meaning of
the keys is in `robot_file`, `world_file` and `server_file`.

Values of one key of an ini section, in the order of the file.

Entries of one section of an ini file, and which of their keys were read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.text_files import read_text_file
from catoptra_server.config.known_names import UnknownName, suggest_name

_OPERATORS = "+.-!"
# Not str.splitlines, which also ends a line at form feeds and U+2028: the line numbers of error
# messages would differ from an editor's.
_LINE_END = re.compile(r"\r\n|\r|\n")
# The largest real file, UT2004's, has 60 kB. The limit keeps a mistaken path, such as a mesh's or a
# video's, from being read into memory.
_MAX_FILE_BYTES = 4 * 1024 * 1024
# The largest real file has 1500 lines. A line takes up to 350 bytes as an entry, so that a file
# takes 23 MB at most, and 16 files that are based on each other 370 MB.
MAX_FILE_LINES = 2**16


@dataclass(frozen=True, slots=True)
class Entry:
    """One `key=value` line."""

    key: str
    """The key as written, without its prefix."""
    value: str
    """The text after =, without comment and surrounding spaces."""
    operator: str
    """Prefix of the key: one of + . - ! or empty."""
    where: SourceLocation
    """File and line."""


@dataclass(frozen=True, slots=True)
class Section:
    """One `[name]` with the entries below it, in the order of the file."""

    name: str
    where: SourceLocation
    entries: tuple[Entry, ...]


def read_sections(path: Path) -> tuple[Section, ...]:
    """Sections of a file, in order.

    Raises:
        ConfigError: for an unreadable or oversized file, or a line outside the grammar.
    """
    text = read_text_file(path, kind="ini file", max_bytes=_MAX_FILE_BYTES)
    return parse_sections(text, file=str(path))


def parse_sections(text: str, *, file: str) -> tuple[Section, ...]:
    """Sections of ini text; `file` is the name for error messages.

    Raises:
        ConfigError: for a line outside the grammar, or more than MAX_FILE_LINES lines.
    """
    # Name, location and entries of each section; a section without entries counts, since
    # [..MultiView] is a switch.
    found: list[tuple[str, SourceLocation, list[Entry]]] = []
    # One split beyond the limit: the rest of an oversized text stays one string.
    for number, raw in enumerate(_LINE_END.split(text, MAX_FILE_LINES), 1):
        where, line = SourceLocation(file, number), strip_comment(raw).strip()
        if number > MAX_FILE_LINES and raw.strip():
            raise ConfigError(
                where, key="file", value="further lines", expected=f"at most {MAX_FILE_LINES} lines"
            )
        if not line:
            continue
        if line.startswith("["):
            found.append((_parse_section_name(line, where), where, []))
        elif not found:
            raise ConfigError(where, key="line", value=line, expected="a [Package.Class] first")
        else:
            found[-1][2].append(_parse_entry(line, where))
    return tuple(Section(name, where, tuple(entries)) for name, where, entries in found)


def strip_comment(line: str) -> str:
    """Line up to its comment; a ; inside quotes is text."""
    quoted = False
    for i, character in enumerate(line):
        if character == '"':
            quoted = not quoted
        elif character == ";" and not quoted:
            return line[:i]
    return line


def _parse_section_name(line: str, where: SourceLocation) -> str:
    name = line[1:-1].strip()
    if not line.endswith("]") or not name:
        raise ConfigError(where, key="section", value=line, expected="[Package.Class]")
    return name


def _parse_entry(line: str, where: SourceLocation) -> Entry:
    key, equals, value = line.partition("=")
    key = key.strip()
    operator = key[:1] if key[:1] in _OPERATORS else ""
    key = key[len(operator) :].strip()
    if not equals or not key:
        raise ConfigError(where, key="line", value=line, expected="key=value")
    return Entry(key, value.strip(), operator, where)


def parse_struct(value: str) -> list[tuple[str, str]] | None:
    """Members of a struct literal as (name, text); None for any other text.

    Text after the closing bracket is ignored: a real file has `'was y=-1.2` there.
    """
    if not value.startswith("("):
        return None
    # A scanner, not a regular expression: structs nest, and quoted text may contain brackets.
    members: list[tuple[str, str]] = []
    depth, quoted, start = 0, False, 1
    for i, character in enumerate(value):
        if character == '"':
            quoted = not quoted
        elif quoted:
            continue
        elif character == "(":
            depth += 1
        elif (character == ")" and depth == 1) or (character == "," and depth == 1):
            piece = value[start:i].strip()
            # A trailing comma leaves an empty piece.
            if piece:
                name, equals, text = piece.partition("=")
                if not equals or not name.strip():
                    return None
                members.append((name.strip(), text.strip()))
            start = i + 1
            if character == ")":
                return members
        elif character == ")":
            depth -= 1
    return None


def unquote(value: str) -> str:
    """Value without its quotes, or the name inside class'...'."""
    if len(value) >= 2 and value[0] == value[-1] == '"':
        return value[1:-1]
    prefix, quote, rest = value.partition("'")
    if quote and rest.endswith("'") and prefix.strip().isidentifier():
        return rest[:-1]
    return value


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
