"""The file of landmarks that the server renders and the client localizes with.

A CSV with one landmark per row. Positions are in the world frame (SAE: x, y level, z down), heights
are above the floor. A landmark has a lower and an upper colour, each filling half of the band
between `band_bottom_m` and `band_top_m`; below the band a beacon is white. Two equal colours make
one band.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from dataclasses import fields
from io import StringIO
from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.limits import MAX_LANDMARK_FILE_BYTES, MAX_LANDMARKS
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.text_files import read_text_file

BAND_COLOURS = ("cyan", "magenta", "yellow")
_LANDMARK_KINDS = ("beacon", "goal")
# Farther than any field; a float32, as renderers have it, still has steps of 8 mm there.
_MAX_COORDINATE_M = 1e5


@dataclass(frozen=True, slots=True)
class Landmark:
    """One landmark.

    A beacon is an upright cylinder, a goal a box with its mouth towards the field.
    """

    name: str
    kind: str
    """One of LANDMARK_KINDS."""
    x_m: float
    """Axis of a beacon; centre of a goal's mouth, on the goal line."""
    y_m: float
    width_m: float
    """Diameter of a beacon; width of a goal's mouth."""
    depth_m: float
    """Distance from the mouth to the rear wall of a goal; unused for a beacon."""
    band_bottom_m: float
    band_top_m: float
    lower_colour: str
    """One of BAND_COLOURS, as `upper_colour`."""
    upper_colour: str

    @property
    def band_centre_m(self) -> float:
        """Height of the border between the two colours."""
        return 0.5 * (self.band_bottom_m + self.band_top_m)


def read_landmarks(path: Path) -> tuple[Landmark, ...]:
    """Read the landmarks of a CSV file.

    Raises:
        ConfigError: The file is unreadable, too large or wrong; names line, column and value.
    """
    text = read_text_file(path, kind="CSV file", max_bytes=MAX_LANDMARK_FILE_BYTES)
    # Split at LF only: splitlines would also split at form feeds, and shift the line numbers.
    return landmarks_from_lines(text.split("\n"), file=str(path))


def landmarks_from_lines(lines: Iterable[str], *, file: str) -> tuple[Landmark, ...]:
    """Parse the landmarks of CSV lines.

    Args:
        lines: Header and rows; # starts a comment line.
        file: Name of the file in error texts.

    Raises:
        ConfigError: A line is wrong; names line, column and value.
    """
    # Numbered before comments and blank lines are dropped, so that errors name lines of the file.
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line.strip()[:1] not in ("", "#")]
    if len(numbered) > MAX_LANDMARKS + 1:
        number, line = numbered[MAX_LANDMARKS + 1]
        expected = f"at most {MAX_LANDMARKS} landmarks"
        raise ConfigError(SourceLocation(file, number), key="row", value=line, expected=expected)
    names = [field.name for field in fields(Landmark)]
    number, header = numbered[0] if numbered else (1, "")
    where = SourceLocation(file, number)
    columns = _parse_columns(where, header) if header else []
    if columns != names:
        raise ConfigError(
            where, key="header", value=header, expected=_describe_columns(columns, names)
        )
    # By name, to find repeated ones; in the order of the file.
    landmarks: dict[str, Landmark] = {}
    for i, line in numbered[1:]:
        landmark = _parse_landmark(SourceLocation(file, i), line, names)
        if not landmark.name or landmark.name in landmarks:
            expected = "a name" if not landmark.name else "each name only once"
            raise ConfigError(
                SourceLocation(file, i), key="name", value=landmark.name, expected=expected
            )
        landmarks[landmark.name] = landmark
    return tuple(landmarks.values())


def csv_from_landmarks(landmarks: Iterable[Landmark]) -> str:
    """Text of a CSV file that reads back as the same landmarks."""
    names = [field.name for field in fields(Landmark)]
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([getattr(landmark, name) for name in names] for landmark in landmarks)
    return text.getvalue()


def _describe_columns(found: list[str], expected: list[str]) -> str:
    """The columns of a header, and which of them a wrong one lacks or has too many."""
    missing = [name for name in expected if name not in found]
    unknown = [name for name in found if name not in expected]
    hint = f"; missing: {', '.join(missing)}" if missing else ""
    hint += f"; unknown: {', '.join(unknown)}" if unknown else ""
    return f"the columns {','.join(expected)} in this order{hint}"


def _parse_columns(location: SourceLocation, line: str) -> list[str]:
    # One line at a time: a quoted line end would join rows, and shift the line numbers.
    try:
        return [value.strip() for value in next(csv.reader([line]))]
    except csv.Error as error:
        raise ConfigError(
            location, key="row", value=line[:80], expected=f"a CSV ({error})"
        ) from error


def _parse_landmark(location: SourceLocation, line: str, names: list[str]) -> Landmark:
    values = _parse_columns(location, line)
    if len(values) != len(names):
        raise ConfigError(
            location, key="row", value=line, expected=f"{len(names)} columns, not {len(values)}"
        )
    row = dict(zip(names, values, strict=True))
    for key, allowed in (
        ("kind", _LANDMARK_KINDS),
        ("lower_colour", BAND_COLOURS),
        ("upper_colour", BAND_COLOURS),
    ):
        if row[key] not in allowed:
            raise ConfigError(
                location, key=key, value=row[key], expected="one of " + ", ".join(allowed)
            )
    # The suffix of a field's name is its type: all lengths are floats, all other columns text.
    numbers = {key: _parse_metres(location, key, row[key]) for key in names if key.endswith("_m")}
    texts = {key: row[key] for key in names if not key.endswith("_m")}
    landmark = Landmark(**texts, **numbers)  # type: ignore[arg-type] # keys are split by type above
    if not (landmark.width_m > 0.0 and 0.0 <= landmark.band_bottom_m < landmark.band_top_m):
        raise ConfigError(
            location, key="row", value=line, expected="width > 0 and 0 <= bottom < top"
        )
    if landmark.kind == "goal" and landmark.depth_m <= 0.0:
        raise ConfigError(
            location, key="depth_m", value=row["depth_m"], expected="a goal's depth > 0"
        )
    return landmark


def _parse_metres(location: SourceLocation, key: str, value: str) -> float:
    try:
        metres = float(value)
    except ValueError:
        metres = math.nan
    if not abs(metres) <= _MAX_COORDINATE_M:  # nan is not
        expected = f"a number of metres, at most {_MAX_COORDINATE_M:g}"
        raise ConfigError(location, key=key, value=value, expected=expected)
    return metres
