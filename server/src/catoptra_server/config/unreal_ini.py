"""Grammar of Unreal's ini files, as real USARBot.ini and UDK files use it.

`[Package.Class]` sections that may occur twice, `key=value`, the prefixes + . - ! of keys, `;`
comments (whole line or trailing), quoted strings, class'Package.Name' references and nested struct
literals (A=1,B=(X=0)). Real files also have, and the reader accepts: spaces around =, a stray ;
after a value, text after a struct's closing bracket, missing blank lines, any line end. Prefixes
are applied, and values typed, by `section_reader`.
"""

from __future__ import annotations

import re
from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.text_files import read_text_file

_OPERATORS = "+.-!"
# Not str.splitlines, which also ends a line at form feeds and U+2028: the line numbers of error
# messages would differ from an editor's.
_LINE_END = re.compile(r"\r\n|\r|\n")
# The largest real file, UT2004's, has 60 kB. The limit keeps a mistaken path, such as a mesh's or a
# video's, from being read into memory.
_MAX_FILE_BYTES = 4 * 1024 * 1024
# The largest real file has 1500 lines. A line takes up to 350 bytes as an entry, so that a file
# takes 23 MB at most, and 16 files that are based on each other 370 MB.
_MAX_FILE_LINES = 2**16


@dataclass(frozen=True, slots=True)
class Entry:
    """One `key=value` line."""

    key: str
    """The key as written, without the prefix."""
    value: str
    """The text after =, without comment and surrounding spaces."""
    operator: str
    """Prefix of the key: one of + . - ! or empty."""
    where: SourceLocation
    """File and line."""


@dataclass(frozen=True, slots=True)
class Section:
    """One `[name]` with the entries below, in the order of the file."""

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
        ConfigError: for a line outside the grammar, or more than _MAX_FILE_LINES lines.
    """
    # Name, location and entries of each section; a section without entries counts, since
    # [..MultiView] is a switch.
    found: list[tuple[str, SourceLocation, list[Entry]]] = []
    # One split beyond the limit: the rest of an oversized text stays one string.
    for number, raw in enumerate(_LINE_END.split(text, _MAX_FILE_LINES), 1):
        where, line = SourceLocation(file, number), strip_comment(raw).strip()
        if number > _MAX_FILE_LINES and raw.strip():
            raise ConfigError(
                where,
                key="file",
                value="further lines",
                expected=f"at most {_MAX_FILE_LINES} lines",
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
    """Value without quotes, or the name inside class'...'."""
    if len(value) >= 2 and value[0] == value[-1] == '"':
        return value[1:-1]
    prefix, quote, rest = value.partition("'")
    if quote and rest.endswith("'") and prefix.strip().isidentifier():
        return rest[:-1]
    return value


def strip_comment(line: str) -> str:
    """Line up to the comment; a ; inside quotes is text."""
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
