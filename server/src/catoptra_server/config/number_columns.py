"""Columns of measured numbers in a text file beside a robot's file, such as a mirror's profile.

A row a line: numbers with commas, semicolons, tabs or spaces between. Empty lines, lines that
begin with #, and one line of titles before the first row count as no rows.
"""

from __future__ import annotations

import re
from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.text_files import read_text_file
from catoptra_server.config.number_values import parse_number
from catoptra_server.config.section_reader import SectionReader

Columns = tuple[tuple[float, ...], ...]

_MAX_FILE_BYTES = 2**20
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")


def read_columns(section: SectionReader, key: str, titles: tuple[str, ...]) -> Columns:
    """Columns of the file that a key names, relative to the folder of the section's file.

    The first column increases.

    Args:
        section: Section with the key.
        key: Key of the path.
        titles: Names of the columns, for error messages.

    Raises:
        ConfigError: A missing or oversized file, or a row of other than that many numbers, or one
            that does not increase, at its line.
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
        values = [parse_number(part) for part in _SEPARATOR.split(stripped)]
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
