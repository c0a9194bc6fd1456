"""Grammar of Unreal's ini files, as real USARBot.ini and UDK files use it.

`[Package.Class]` sections that may occur twice, `key=value`, the prefixes + . - ! of keys, `;`
comments (whole line or trailing), quoted strings, class'Package.Name' references and nested struct
literals (A=1,B=(X=0)). Also accepted, since real files have them: spaces around =, a stray ; after
a value, text after a struct's closing bracket, missing blank lines, any line end. The meaning of
the keys is in `robot_file`, `world_file` and `server_file`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation

_OPERATORS = "+.-!"
# Not str.splitlines, which also ends a line at form feeds and U+2028: the line numbers of error
# messages would differ from an editor's.
_LINE_END = re.compile(r"\r\n|\r|\n")
# The largest real file, UT2004's, has 60 kB. The limit keeps a mistaken path, such as a mesh's or a
# video's, from being read into memory.
_MAX_FILE_BYTES = 4 * 1024 * 1024


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
    where = SourceLocation(str(path))
    try:
        size = path.stat().st_size
        # Checked before reading: sizes are limited before memory is taken.
        data = path.read_bytes() if size <= _MAX_FILE_BYTES else None
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise ConfigError(
            where, key="file", value=str(path), expected=f"a readable ini file ({error})"
        ) from error
    if data is None:
        raise ConfigError(where, key="file", value=f"{size} bytes", expected="at most 4 MiB")
    return parse_sections(_decode(data, file=str(path)), file=str(path))


def _decode(data: bytes, *, file: str) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        where = SourceLocation(file, data.count(b"\n", 0, error.start) + 1)
        byte = repr(data[error.start : error.end])
        raise ConfigError(where, key="file", value=byte, expected="UTF-8 text") from error


def parse_sections(text: str, *, file: str) -> tuple[Section, ...]:
    """Sections of ini text; `file` is the name for error messages."""
    sections: list[Section] = []
    entries: list[Entry] = []
    for number, raw in enumerate(_LINE_END.split(text), 1):
        where, line = SourceLocation(file, number), strip_comment(raw).strip()
        if not line:
            continue
        if line.startswith("["):
            # Appended at once, since a section without entries counts: [..MultiView] is a switch.
            entries = []
            sections.append(_parse_section(line, where, entries))
        elif not sections:
            raise ConfigError(where, key="line", value=line, expected="a [Package.Class] first")
        else:
            entries.append(_parse_entry(line, where))
            sections[-1] = Section(sections[-1].name, sections[-1].where, tuple(entries))
    return tuple(sections)


def strip_comment(line: str) -> str:
    """Line up to its comment; a ; inside quotes is text."""
    quoted = False
    for i, character in enumerate(line):
        if character == '"':
            quoted = not quoted
        elif character == ";" and not quoted:
            return line[:i]
    return line


def _parse_section(line: str, where: SourceLocation, entries: list[Entry]) -> Section:
    name = line[1:-1].strip()
    if not line.endswith("]") or not name:
        raise ConfigError(where, key="section", value=line, expected="[Package.Class]")
    return Section(name, where, tuple(entries))


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
