"""Typed values of ini sections. Every complaint names file, line, key, value and what was expected.

A `Settings` is one section (all sections of that name together, later lines over earlier ones) or
one struct literal. It remembers which keys were asked for, so that the others can be reported,
once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from catoptra_protocol.errors import ConfigError, Where
from catoptra_protocol.wire.limits import MAX_NAME_CHARS
from catoptra_server.config.unreal_ini import Entry, plain_text, struct_members

Vector = tuple[float, float, float]

# What a name on the wire is made of: Latin-1 that can be seen, neither space nor brace.
_WORD = re.compile(rf"[!-z|~\xa1-\xff]{{1,{MAX_NAME_CHARS}}}")
WORD_EXPECTED = "one word without spaces and braces: it is sent to clients"


class Settings:
    """The entries of one section or struct, by lower-case key, in order."""

    def __init__(self, name: str, where: Where, entries: Iterable[Entry]) -> None:
        self.name = name
        self.where = where
        self._lines: list[Entry] = []
        self._entries: dict[str, list[Entry]] = {}
        self._structs: dict[str, list[Settings]] = {}
        self._asked: set[str] = set()
        for entry in entries:
            self.add(entry)

    def add(self, entry: Entry) -> None:
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

    def overlay(self, other: Settings) -> None:
        """Let a derived section win: its keys replace ours, its + . - ! lines change them."""
        changed: set[str] = set()
        for entry in other._lines:
            key = entry.key.lower()
            if key not in changed and not entry.operator:
                self._entries.pop(key, None)
            changed.add(key)
            self.add(entry)

    def has(self, key: str) -> bool:
        """Return whether the key has a value."""
        return bool(self._entries.get(key.lower()))

    @property
    def is_used(self) -> bool:
        """Return whether any key was asked for."""
        return bool(self._asked)

    def pass_over(self) -> None:
        """Take every key for known: what holds them has no meaning here, or was reported whole."""
        self._asked.update(self._entries)

    def unknown(self) -> list[Entry]:
        """Return the entries whose key nobody asked for, members of structs among them."""
        own = [
            entry
            for key, entries in self._entries.items()
            if key not in self._asked
            for entry in entries
        ]
        structs = (struct for structs in self._structs.values() for struct in structs)
        return [*own, *(entry for struct in structs for entry in struct.unknown())]

    def _last(self, key: str, expected: str) -> Entry:
        entries = self._all(key)
        if not entries:
            raise ConfigError(
                self.where,
                key=f"{self.name}.{key}",
                value="",
                expected=f"{expected}; it is missing",
            )
        return entries[-1]

    def _all(self, key: str) -> list[Entry]:
        self._asked.add(key.lower())
        return self._entries.get(key.lower(), [])

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text, without quotes or class'...'."""
        if default is not None and not self._all(key):
            return default
        return plain_text(self._last(key, "a text").value)

    def word(self, key: str, default: str | None = None) -> str:
        """Return a name that the wire can carry."""
        text = self.text(key, default)
        if not is_word(text):
            raise self.complain(key, expected=WORD_EXPECTED)
        return text

    def file(self, key: str, folder: Path) -> Path:
        """Return the path of a file that exists; a relative one starts in the folder."""
        path = folder / self.text(key).replace("\\", "/")
        if not path.is_file():
            raise self.complain(key, expected=f"a file that exists; there is no {path}")
        return path

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        at_least: float = -math.inf,
        at_most: float = math.inf,
    ) -> float:
        """Return a finite number within bounds, both included."""
        if default is not None and not self._all(key):
            return default
        expected = _expected("a number", at_least, at_most)
        entry = self._last(key, expected)
        value = _number(entry.value)
        if value is None or not at_least <= value <= at_most:
            raise ConfigError(entry.where, key=entry.key, value=entry.value, expected=expected)
        return value

    def integer(
        self, key: str, default: int | None = None, *, at_least: int = 0, at_most: int = 2**31
    ) -> int:
        """Return a whole number within bounds, both included."""
        if default is not None and not self._all(key):
            return default
        expected = _expected("a whole number", at_least, at_most)
        entry = self._last(key, expected)
        value = _number(entry.value)
        if value is None or value != int(value) or not at_least <= value <= at_most:
            raise ConfigError(entry.where, key=entry.key, value=entry.value, expected=expected)
        return int(value)

    def boolean(self, key: str, default: bool) -> bool:
        """Return a truth value: true, false, 1 or 0 in any case."""
        if not self._all(key):
            return default
        entry = self._last(key, "true or false")
        words = {"true": True, "1": True, "false": False, "0": False}
        if entry.value.lower() not in words:
            raise ConfigError(
                entry.where, key=entry.key, value=entry.value, expected="true or false"
            )
        return words[entry.value.lower()]

    def choice(self, key: str, allowed: Sequence[str], default: str | None = None) -> str:
        """Return one of the allowed words, spelled as in `allowed`, whatever its case."""
        if default is not None and not self._all(key):
            return default
        expected = "one of " + ", ".join(allowed)
        entry = self._last(key, expected)
        for word in allowed:
            if plain_text(entry.value).lower() == word.lower():
                return word
        raise ConfigError(entry.where, key=entry.key, value=entry.value, expected=expected)

    def vector(
        self,
        key: str,
        default: Vector | None = None,
        *,
        members: str = "XYZ",
        at_least: float = -math.inf,
        at_most: float = math.inf,
    ) -> Vector:
        """Return three numbers of a struct such as (X=1,Y=2,Z=3); a missing member is 0."""
        if default is not None and not self._all(key):
            return default
        struct = self.struct(key)
        a, b, c = (struct.number(m, 0.0, at_least=at_least, at_most=at_most) for m in members)
        return a, b, c

    def struct(self, key: str) -> Settings:
        """Return the struct literal of a key."""
        self._last(key, "a struct such as (X=0,Y=0,Z=0)")
        return self.structs(key)[-1]

    def structs(self, key: str) -> list[Settings]:
        """Return all struct literals of a repeated key, in order; none is an empty list."""
        entries = self._all(key)
        if key.lower() not in self._structs:
            self._structs[key.lower()] = [_struct(entry) for entry in entries]
        return self._structs[key.lower()]

    def complain(self, key: str, *, expected: str) -> ConfigError:
        """Return the error for a value that is well formed but makes no sense here."""
        entries = self._all(key)
        where = entries[-1].where if entries else self.where
        value = entries[-1].value if entries else ""
        return ConfigError(where, key=f"{self.name}.{key}", value=value, expected=expected)


def is_word(text: str) -> bool:
    """Return whether the wire can carry a text as a name."""
    return _WORD.fullmatch(text) is not None


def _struct(entry: Entry) -> Settings:
    members = struct_members(entry.value)
    if members is None:
        raise ConfigError(
            entry.where, key=entry.key, value=entry.value, expected="a struct such as (X=0,Y=0,Z=0)"
        )
    inner = (Entry(name, text, "", entry.where) for name, text in members)
    return Settings(entry.key, entry.where, inner)


def _number(text: str) -> float | None:
    try:
        value = float(text.rstrip("fF")) if text[:1] not in "nNiI" else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _expected(kind: str, at_least: float, at_most: float) -> str:
    if math.isinf(at_least) and math.isinf(at_most):
        return kind
    if math.isinf(at_most) or at_most == 2**31:
        return f"{kind} of at least {at_least:g}"
    if math.isinf(at_least):
        return f"{kind} of at most {at_most:g}"
    return f"{kind} from {at_least:g} to {at_most:g}"
