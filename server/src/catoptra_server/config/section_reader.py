"""Typed values of ini sections. Every complaint names file, line, key, value and what was expected.

A `SectionReader` is one section (all sections of that name together, later lines over earlier ones) or
one struct literal. It remembers which keys were asked for, so that the others can be reported,
once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.limits import MAX_NAME_CHARS
from catoptra_server.config.unreal_ini import Entry, parse_struct, unquote

Vector = tuple[float, float, float]

# What a name on the wire is made of: Latin-1 that can be seen, neither space nor brace.
_WIRE_NAME = re.compile(rf"[!-z|~\xa1-\xff]{{1,{MAX_NAME_CHARS}}}")
WIRE_NAME_EXPECTED = "one word without spaces and braces: it is sent to clients"


class SectionReader:
    """The entries of one section or struct, by lower-case key, in order."""

    def __init__(self, name: str, where: SourceLocation, entries: Iterable[Entry]) -> None:
        self.name = name
        self.where = where
        self._lines: list[Entry] = []
        self._entries: dict[str, list[Entry]] = {}
        self._structs: dict[str, list[SectionReader]] = {}
        self._used_keys: set[str] = set()
        for entry in entries:
            self.apply(entry)

    def apply(self, entry: Entry) -> None:
        """Apply a line: bare repetition and . append, + appends if new, - removes, ! clears."""
        self._lines.append(entry)
        values = self._entries.setdefault(entry.key.lower(), [])
        match entry.operator:
            case "!":
                values.clear()
            case "-":
                values[:] = [v for v in values if v.value != entry.value]
            case "+" if any(v.value == entry.value for v in values):
                pass
            case _:
                values.append(entry)

    def apply_overrides(self, derived: SectionReader) -> None:
        """Let a derived section win: its keys replace ours, its + . - ! lines change them."""
        changed: set[str] = set()
        for entry in derived._lines:
            key = entry.key.lower()
            if key not in changed and not entry.operator:
                self._entries.pop(key, None)
            changed.add(key)
            self.apply(entry)

    def has_key(self, key: str) -> bool:
        """Return whether the key has a value."""
        return bool(self._entries.get(key.lower()))

    @property
    def is_used(self) -> bool:
        """Return whether any key was asked for."""
        return bool(self._used_keys)

    def ignore_all(self) -> None:
        """Take every key for known: what holds them has no meaning here, or was reported whole."""
        self._used_keys.update(self._entries)

    def unknown_entries(self) -> list[Entry]:
        """Return the entries whose key nobody asked for, members of structs among them."""
        own = [
            entry
            for key, entries in self._entries.items()
            if key not in self._used_keys
            for entry in entries
        ]
        structs = (struct for structs in self._structs.values() for struct in structs)
        return [*own, *(entry for struct in structs for entry in struct.unknown_entries())]

    def _last_entry(self, key: str, expected: str) -> Entry:
        entries = self._use_entries(key)
        if not entries:
            raise ConfigError(
                self.where,
                key=f"{self.name}.{key}",
                value="",
                expected=f"{expected}; it is missing",
            )
        return entries[-1]

    def _use_entries(self, key: str) -> list[Entry]:
        self._used_keys.add(key.lower())
        return self._entries.get(key.lower(), [])

    def get_str(self, key: str, default: str | None = None) -> str:
        """Return a text, without quotes or class'...'."""
        if default is not None and not self._use_entries(key):
            return default
        return unquote(self._last_entry(key, "a text").value)

    def get_wire_name(self, key: str, default: str | None = None) -> str:
        """Return a name that the wire can carry."""
        text = self.get_str(key, default)
        if not is_wire_name(text):
            raise self.make_error(key, expected=WIRE_NAME_EXPECTED)
        return text

    def get_path(self, key: str, folder: Path) -> Path:
        """Return the path of a file that exists; a relative one starts in the folder."""
        path = folder / self.get_str(key).replace("\\", "/")
        if not path.is_file():
            raise self.make_error(key, expected=f"a file that exists; there is no {path}")
        return path

    def get_float(
        self,
        key: str,
        default: float | None = None,
        *,
        min_value: float = -math.inf,
        max_value: float = math.inf,
    ) -> float:
        """Return a finite number within bounds, both included."""
        if default is not None and not self._use_entries(key):
            return default
        expected = _describe_range("a number", min_value, max_value)
        entry = self._last_entry(key, expected)
        value = _parse_float(entry.value)
        if value is None or not min_value <= value <= max_value:
            raise ConfigError(entry.where, key=entry.key, value=entry.value, expected=expected)
        return value

    def get_int(
        self, key: str, default: int | None = None, *, min_value: int = 0, max_value: int = 2**31
    ) -> int:
        """Return a whole number within bounds, both included."""
        if default is not None and not self._use_entries(key):
            return default
        expected = _describe_range("a whole number", min_value, max_value)
        entry = self._last_entry(key, expected)
        value = _parse_float(entry.value)
        if value is None or value != int(value) or not min_value <= value <= max_value:
            raise ConfigError(entry.where, key=entry.key, value=entry.value, expected=expected)
        return int(value)

    def get_bool(self, key: str, default: bool) -> bool:
        """Return a truth value: true, false, 1 or 0 in any case."""
        if not self._use_entries(key):
            return default
        entry = self._last_entry(key, "true or false")
        words = {"true": True, "1": True, "false": False, "0": False}
        if entry.value.lower() not in words:
            raise ConfigError(
                entry.where, key=entry.key, value=entry.value, expected="true or false"
            )
        return words[entry.value.lower()]

    def get_choice(self, key: str, allowed: Sequence[str], default: str | None = None) -> str:
        """Return one of the allowed words, spelled as in `allowed`, whatever its case."""
        if default is not None and not self._use_entries(key):
            return default
        expected = "one of " + ", ".join(allowed)
        entry = self._last_entry(key, expected)
        for word in allowed:
            if unquote(entry.value).lower() == word.lower():
                return word
        raise ConfigError(entry.where, key=entry.key, value=entry.value, expected=expected)

    def get_vector(
        self,
        key: str,
        default: Vector | None = None,
        *,
        members: str = "XYZ",
        min_value: float = -math.inf,
        max_value: float = math.inf,
    ) -> Vector:
        """Return three numbers of a struct such as (X=1,Y=2,Z=3); a missing member is 0."""
        if default is not None and not self._use_entries(key):
            return default
        struct = self.get_struct(key)
        a, b, c = (
            struct.get_float(m, 0.0, min_value=min_value, max_value=max_value) for m in members
        )
        return a, b, c

    def get_struct(self, key: str) -> SectionReader:
        """Return the struct literal of a key."""
        self._last_entry(key, "a struct such as (X=0,Y=0,Z=0)")
        return self.get_structs(key)[-1]

    def get_structs(self, key: str) -> list[SectionReader]:
        """Return all struct literals of a repeated key, in order; none is an empty list."""
        entries = self._use_entries(key)
        if key.lower() not in self._structs:
            self._structs[key.lower()] = [_parse_struct(entry) for entry in entries]
        return self._structs[key.lower()]

    def make_error(self, key: str, *, expected: str) -> ConfigError:
        """Return the error for a value that is well formed but makes no sense here."""
        entries = self._use_entries(key)
        where = entries[-1].where if entries else self.where
        value = entries[-1].value if entries else ""
        return ConfigError(where, key=f"{self.name}.{key}", value=value, expected=expected)


def is_wire_name(text: str) -> bool:
    """Return whether the wire can carry a text as a name."""
    return _WIRE_NAME.fullmatch(text) is not None


def _parse_struct(entry: Entry) -> SectionReader:
    members = parse_struct(entry.value)
    if members is None:
        raise ConfigError(
            entry.where, key=entry.key, value=entry.value, expected="a struct such as (X=0,Y=0,Z=0)"
        )
    inner = (Entry(name, text, "", entry.where) for name, text in members)
    return SectionReader(entry.key, entry.where, inner)


def _parse_float(text: str) -> float | None:
    try:
        value = float(text.rstrip("fF")) if text[:1] not in "nNiI" else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _describe_range(kind: str, min_value: float, max_value: float) -> str:
    if math.isinf(min_value) and math.isinf(max_value):
        return kind
    if math.isinf(max_value) or max_value == 2**31:
        return f"{kind} of at least {min_value:g}"
    if math.isinf(min_value):
        return f"{kind} of at most {max_value:g}"
    return f"{kind} from {min_value:g} to {max_value:g}"
