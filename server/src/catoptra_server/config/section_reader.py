"""Typed values of an ini section or a struct literal, with located errors.

An error names file, line, key, value and the expected form, and the key that was probably misspelt.
A reader records which keys were read; the rest is reported as unknown once all readers are done.
What a key means is decided in `robot_file`, `world_file` and other readers.

Numbers are finite and bounded: "nan" and "inf", which float() accepts, are no literals of
UnrealScript. Names that clients receive are words of the control protocol.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.limits import MAX_NAME_CHARS
from catoptra_protocol.names import suggest_name
from catoptra_protocol.text_files import read_text_file
from catoptra_server.config.known_names import (
    FileKind,
    UnknownName,
    describe_missing_file,
    find_bundled_file,
)
from catoptra_server.config.unreal_ini import Entry, parse_struct, unquote

Vector = tuple[float, float, float]
# Bound of all numbers: squares and products of a few stay finite in float32, too. A
# robot's battery of 30 years has 1e9 s; no length, mass or angle of a real file is near.
_MAX_NUMBER = 1e9
# A key that was not read so far may be read later: WheelBase is no misspelt WheelRadius.
_MIN_SIMILARITY = 0.75
# Printable Latin-1 without space and braces, which delimit names in a line of the protocol.
_WIRE_NAME = re.compile(rf"[!-z|~\xa1-\xff]{{1,{MAX_NAME_CHARS}}}")
_WIRE_NAME_EXPECTED = "one word without spaces and braces: it is sent to clients"
_MAX_FILE_BYTES = 2**20
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")


class SectionReader:
    """Entries of one section or struct, by lower-case key, in the order of the file."""

    def __init__(
        self,
        name: str,
        where: SourceLocation,
        entries: Iterable[Entry],
        *,
        is_struct: bool = False,
        absence: str = "",
    ) -> None:
        """Read entries.

        Args:
            name: Name of the section, or key of the struct.
            where: First line.
            entries: Lines of the section, or members of the struct.
            is_struct: Whether errors name the struct beside its member.
            absence: For an absent section, what errors say of that.
        """
        self.name = name
        self.where = where
        self._is_struct = is_struct
        self._absence = absence
        # The lines as written: a derived section is replayed line by line over its base, operators
        # included, which the resulting values alone would no longer show.
        self._lines: list[Entry] = []
        self._entries: dict[str, _EntryList] = {}
        # Spelt as by readers, by lower-case key.
        self._used_keys: dict[str, str] = {}
        # Parsed once, so that all readers of a struct record their keys in the same object.
        self._structs: dict[str, list[SectionReader]] = {}
        for entry in entries:
            self.apply(entry)

    def apply(self, entry: Entry) -> None:
        """Apply a line: a repeated key and . append, + appends if new, - removes, ! clears."""
        self._lines.append(entry)
        self._entries.setdefault(entry.key.lower(), _EntryList()).apply(entry)

    def apply_overrides(self, derived: SectionReader) -> None:
        """Apply a derived section: plain keys replace values, + . - ! lines modify lists."""
        changed: set[str] = set()
        for entry in derived._lines:
            key = entry.key.lower()
            # Only the first plain line of a key clears the base's list; the next ones extend the
            # list.
            if key not in changed and not entry.operator:
                self._entries.pop(key, None)
            changed.add(key)
            self.apply(entry)

    def has_key(self, key: str) -> bool:
        """Whether the key has a value; does not count as reading the key."""
        return bool(self._entries.get(key.lower()))

    def keys(self) -> list[str]:
        """Keys as written, for sections whose keys are names of the user's."""
        return [lines.last.key for lines in self._entries.values() if lines]

    @property
    def is_used(self) -> bool:
        """Whether any key was read."""
        return bool(self._used_keys)

    @property
    def has_unread_keys(self) -> bool:
        """Whether any key was not read so far."""
        return bool(self._unused_keys())

    def ignore_all(self) -> None:
        """Count every key as read, for a section that has no effect or was reported as a whole."""
        self._used_keys.update({key: key for key in self._entries})

    def unknown_names(self, section: str = "") -> list[UnknownName]:
        """Keys that were not read, also in structs.

        Args:
            section: Name of the section that a struct is in; this reader's own by default.
        """
        section = section or self.name
        known = self._used_keys.values()
        own = [
            UnknownName(
                entry.key, entry.value, entry.where, section, suggest_name(entry.key, known)
            )
            for key in self._unused_keys()
            for entry in self._entries[key]
        ]
        structs = (struct for structs in self._structs.values() for struct in structs)
        return [*own, *(name for struct in structs for name in struct.unknown_names(section))]

    def _unused_keys(self) -> list[str]:
        # A key whose lines were all removed has none left to name.
        return [key for key, lines in self._entries.items() if lines and key not in self._used_keys]

    def _use(self, key: str) -> _EntryList:
        """Entries of a key, which counts as read; empty for a missing one."""
        self._used_keys[key.lower()] = key
        return self._entries.get(key.lower(), _EntryList())

    def _last_entry(self, key: str, expected: str) -> Entry:
        entries = self._use(key)
        if entries:
            return entries.last
        reason = self._absence or "it is missing"
        raise self.make_error(key, expected=f"{expected}; {reason}")

    def _value_error(self, entry: Entry, expected: str) -> ConfigError:
        key = f"{self.name}.{entry.key}" if self._is_struct else entry.key
        return ConfigError(entry.where, key=key, value=entry.value, expected=expected)

    def get_str(self, key: str, default: str | None = None) -> str:
        """Text without quotes or class'...'; a missing key without a default is a ConfigError."""
        if default is not None and not self._use(key):
            return default
        return unquote(self._last_entry(key, "a text").value)

    def get_wire_name(self, key: str, default: str | None = None) -> str:
        """Name that fits a line of the protocol: one word of printable Latin-1 without braces."""
        text = self.get_str(key, default)
        if not _WIRE_NAME.fullmatch(text):
            raise self.make_error(key, expected=_WIRE_NAME_EXPECTED)
        return text

    def require_wire_name(self) -> None:
        """Raise ConfigError unless the section's own name fits a line of the protocol."""
        if not _WIRE_NAME.fullmatch(self.name):
            raise ConfigError(
                self.where, key="section", value=self.name, expected=_WIRE_NAME_EXPECTED
            )

    def get_class_name(self, key: str) -> str:
        """Name of a class without the package, in lower case."""
        return self.get_str(key).rpartition(".")[2].lower()

    def get_path(
        self,
        key: str,
        folder: Path,
        *,
        bundled: FileKind | None = None,
    ) -> Path:
        """Path of an existing file.

        Args:
            key: the key, in any case.
            folder: folder that a relative path is resolved against.
            bundled: kind of bundled files whose bare names are accepted, too.
        """
        return self._find_path(key, self.get_str(key), folder, bundled)

    def get_paths(
        self, key: str, folder: Path, *, bundled: FileKind | None = None
    ) -> tuple[Path, ...]:
        """Paths of existing files, one for each line of the key; as of `get_path`."""
        texts = [unquote(entry.value) for entry in self._use(key)]
        return tuple(self._find_path(key, text, folder, bundled) for text in texts)

    def _find_path(self, key: str, text: str, folder: Path, bundled: FileKind | None) -> Path:
        # UT2004's files are written on Windows.
        text = text.replace("\\", "/")
        path = folder / text
        # Unlike Path.is_file false, not an error, for a name longer than the system's names.
        if os.path.isfile(path):
            return path
        found = find_bundled_file(bundled, text) if bundled else None
        if found is None:
            raise self.make_error(key, expected=describe_missing_file(path, bundled))
        return found

    def get_float(
        self,
        key: str,
        default: float | None = None,
        *,
        min_value: float = -math.inf,
        max_value: float = math.inf,
    ) -> float:
        """Number within bounds, none beyond _MAX_NUMBER.

        Args:
            key: the key, in any case.
            default: result for a missing key, not checked against the bounds; None = required.
            min_value: smallest accepted value.
            max_value: largest accepted value.
        """
        if default is not None and not self._use(key):
            return default
        expected = _describe_range("a number", min_value, max_value)
        entry = self._last_entry(key, expected)
        value = _parse_number(entry.value)
        if value is not None and abs(value) > _MAX_NUMBER:
            expected += f", not beyond {_MAX_NUMBER:g}"
            raise self._value_error(entry, expected)
        if value is None or not min_value <= value <= max_value:
            raise self._value_error(entry, expected)
        return value

    def get_floats(self, key: str, *, max_count: int = 4096) -> tuple[float, ...]:
        """Numbers with commas between, at least one; none beyond _MAX_NUMBER."""
        expected = f"numbers with commas between, at most {max_count}"
        entry = self._last_entry(key, expected)
        parts = unquote(entry.value).strip("()").split(",")
        if len(parts) > max_count:
            raise self._value_error(entry, expected)
        values = tuple(_parse_number(part.strip()) for part in parts)
        if any(value is None or abs(value) > _MAX_NUMBER for value in values):
            raise self._value_error(entry, expected)
        return tuple(value for value in values if value is not None)

    def get_int(
        self, key: str, default: int | None = None, *, min_value: int = 0, max_value: int = 2**31
    ) -> int:
        """Whole number within bounds, both included; arguments as of `get_float`."""
        if default is not None and not self._use(key):
            return default
        expected = _describe_range("a whole number", min_value, max_value)
        entry = self._last_entry(key, expected)
        value = _parse_number(entry.value)
        if value is None or value != int(value) or not min_value <= value <= max_value:
            raise self._value_error(entry, expected)
        return int(value)

    def get_bool(self, key: str, default: bool) -> bool:
        """Truth value: true, false, 1 or 0 in any case."""
        if not self._use(key):
            return default
        entry = self._last_entry(key, "true or false")
        words = {"true": True, "1": True, "false": False, "0": False}
        if entry.value.lower() not in words:
            raise self._value_error(entry, "true or false")
        return words[entry.value.lower()]

    def get_choice(self, key: str, allowed: Sequence[str], default: str | None = None) -> str:
        """One of the allowed words, matched regardless of case, spelled as in `allowed`."""
        if default is not None and not self._use(key):
            return default
        expected = "one of " + ", ".join(allowed)
        entry = self._last_entry(key, expected)
        for word in allowed:
            if unquote(entry.value).lower() == word.lower():
                return word
        close = suggest_name(unquote(entry.value), allowed)
        raise self._value_error(entry, expected + (f"; did you mean {close}?" if close else ""))

    def get_vector(
        self,
        key: str,
        default: Vector | None = None,
        *,
        members: str = "XYZ",
        min_value: float = -math.inf,
        max_value: float = math.inf,
    ) -> Vector:
        """Three numbers of a struct such as (X=1,Y=2,Z=3).

        A missing member is 0; an error where the bounds exclude 0.

        Args:
            key: the key, in any case.
            default: result for a missing key; None = required.
            members: names of the three members, a letter each.
            min_value: smallest accepted value of a member.
            max_value: largest accepted value of a member.
        """
        if default is not None and not self._use(key):
            return default
        example = "(" + ",".join(f"{member}=0" for member in members) + ")"
        struct = self.get_struct(key, example=example)
        # A box without Z would be flat, and no warning would say so.
        missing = 0.0 if min_value <= 0.0 <= max_value else None
        a, b, c = (
            struct.get_float(m, missing, min_value=min_value, max_value=max_value) for m in members
        )
        return a, b, c

    def get_struct(self, key: str, *, example: str = "(X=0,Y=0,Z=0)") -> SectionReader:
        """Struct literal of a key; of a repeated key the last one counts, as for other values."""
        self._last_entry(key, f"a struct such as {example}")
        return self.get_structs(key, example=example)[-1]

    def get_structs(
        self, key: str, *, example: str = '(Name="a",Position=(X=0,Y=0,Z=0))'
    ) -> list[SectionReader]:
        """Struct literals of a repeated key, in order; an empty list for a missing one."""
        entries = self._use(key)
        if key.lower() not in self._structs:
            self._structs[key.lower()] = [_parse_struct(entry, example) for entry in entries]
        return self._structs[key.lower()]

    def make_error(self, key: str, *, expected: str) -> ConfigError:
        """Error for a value that is well formed but not acceptable, to be raised by the caller.

        Args:
            key: the key to be named, with value and line of the last entry if there is one.
            expected: an acceptable value, as a phrase.
        """
        entries = self._use(key)
        value = entries.last.value if entries else ""
        misspelt = "" if entries else suggest_name(key, self._unused_keys(), _MIN_SIMILARITY)
        # In the spelling of the file.
        hint = f"; is {self._entries[misspelt].last.key} meant to be it?" if misspelt else ""
        return ConfigError(
            self.find_location(key),
            key=f"{self.name}.{key}",
            value=value,
            expected=f"{expected}{hint}",
        )

    def find_location(self, key: str) -> SourceLocation:
        """File and line of a key's last entry, or else of the section."""
        entries = self._use(key)
        return entries.last.where if entries else self.where


def read_columns(
    section: SectionReader, key: str, titles: tuple[str, ...]
) -> tuple[tuple[float, ...], ...]:
    """Columns of the file that a key names, relative to the folder of the section's file.

    The first column increases.

    Args:
        section: Section with the key.
        key: Key of the path.
        titles: Names of the columns, for error messages.

    Raises:
        ConfigError: A missing or oversized file, or, at its line, a row with another number of
            columns or one that does not increase.
    """
    folder = Path(section.find_location(key).file).parent
    path = section.get_path(key, folder)
    rows: list[tuple[float, ...]] = []
    text = read_text_file(path, kind="table of numbers", max_bytes=_MAX_FILE_BYTES)
    is_titled = False
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if not stripped or stripped.startswith("#"):
            continue
        values = [_parse_number(part) for part in _SEPARATOR.split(stripped)]
        row = tuple(value for value in values if value is not None)
        expected = ""
        if not len(row) == len(values) == len(titles):
            is_title = not (rows or row or is_titled)
            expected = "" if is_title else f"{len(titles)} numbers, {' and '.join(titles)}"
        elif rows and row[0] <= rows[-1][0]:
            expected = f"{titles[0]} above {rows[-1][0]!r}, that of the row before"
        else:
            rows.append(row)
        if expected:
            where = SourceLocation(str(path), number)
            raise ConfigError(where, key=key, value=stripped, expected=expected)
        is_titled = True
    return tuple(tuple(row[column] for row in rows) for column in range(len(titles)))


class _EntryList:
    """Entries of one key, found and removed by value in constant time.

    A plain list would be searched for each + and - line: 40 000 lines took a minute.
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


def _parse_struct(entry: Entry, example: str) -> SectionReader:
    members = parse_struct(entry.value)
    if members is None:
        is_open = entry.value.count("(") != entry.value.count(")")
        hint = "; a parenthesis is missing, or a ; has made the rest a comment" if is_open else ""
        if entry.value.count('"') % 2:
            hint = "; a quotation mark is missing"
        expected = f"a struct such as {example}{hint}"
        raise ConfigError(entry.where, key=entry.key, value=entry.value, expected=expected)
    # Members share the line of their struct: one struct is one line of the file.
    inner = (Entry(name, text, "", entry.where) for name, text in members)
    return SectionReader(entry.key, entry.where, inner, is_struct=True)


def _parse_number(text: str) -> float | None:
    """Finite number of a literal; None for any other text."""
    # UnrealScript's literals may end in f. "nan", "inf" and their kin, which float() would accept,
    # are no numbers in an ini file.
    try:
        value = float(text.rstrip("fF")) if text[:1] not in "nNiI" else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _describe_range(kind: str, min_value: float, max_value: float) -> str:
    """Kind of number with bounds: "a number from 0 to 10"."""
    if math.isinf(min_value) and math.isinf(max_value):
        return kind
    # 2^31 is the default bound of get_int, which no user set: a message with it would puzzle.
    if math.isinf(max_value) or max_value == 2**31:
        return f"{kind} of at least {min_value:g}"
    if math.isinf(min_value):
        return f"{kind} of at most {max_value:g}"
    return f"{kind} from {min_value:g} to {max_value:g}"
