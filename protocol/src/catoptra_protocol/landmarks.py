"""The file of landmarks: what the server draws and the client localises with.

A CSV with one landmark a row. Positions are in the world frame (SAE: x, y level, z down), heights
are above the floor. A landmark shows a lower and an upper colour, each filling half of the band
between `band_bottom_m` and `band_top_m`; below the band a beacon is white. Both colours equal: one
band.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

from catoptra_protocol.errors import ConfigError, Where

COLOURS = ("cyan", "magenta", "yellow")
KINDS = ("beacon", "goal")


@dataclass(frozen=True, slots=True)
class Landmark:
    """One landmark. A beacon is an upright cylinder, a goal a box open towards the field's middle.

    x_m, y_m: a beacon's axis; the middle of a goal's mouth, on the goal line. width_m: diameter of
    the beacon; width of the goal's mouth. depth_m: how far the goal reaches back.
    """

    name: str
    kind: str
    x_m: float
    y_m: float
    width_m: float
    depth_m: float
    band_bottom_m: float
    band_top_m: float
    lower_colour: str
    upper_colour: str

    @property
    def band_middle_m(self) -> float:
        """Return the height where the two colours meet."""
        return 0.5 * (self.band_bottom_m + self.band_top_m)


def read_landmarks(path: Path) -> tuple[Landmark, ...]:
    """Return the landmarks of a CSV file. Raises ConfigError naming line, column and value."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            Where(str(path)), key="landmarks", value=str(path), expected=f"a readable CSV ({error})"
        ) from error
    return landmarks_from_lines(text.splitlines(), file=str(path))


def landmarks_from_lines(lines: Iterable[str], *, file: str) -> tuple[Landmark, ...]:
    """Return the landmarks of CSV lines; `file` is named in errors; # starts a comment line."""
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line.strip()[:1] not in ("", "#")]
    names = [field.name for field in fields(Landmark)]
    if not numbered or next(csv.reader([numbered[0][1]])) != names:
        found = numbered[0][1] if numbered else ""
        raise ConfigError(
            Where(file, 1), key="header", value=found, expected=f"the columns {','.join(names)}"
        )
    landmarks = tuple(_landmark(Where(file, i), line, names) for i, line in numbered[1:])
    _refuse_twins(landmarks, file)
    return landmarks


def _landmark(where: Where, line: str, names: list[str]) -> Landmark:
    values = [value.strip() for value in next(csv.reader([line]))]
    if len(values) != len(names):
        raise ConfigError(where, key="row", value=line, expected=f"{len(names)} columns")
    row = dict(zip(names, values, strict=True))
    for key, allowed in (("kind", KINDS), ("lower_colour", COLOURS), ("upper_colour", COLOURS)):
        if row[key] not in allowed:
            raise ConfigError(
                where, key=key, value=row[key], expected="one of " + ", ".join(allowed)
            )
    numbers = {key: _metres(where, key, row[key]) for key in names if key.endswith("_m")}
    texts = {key: row[key] for key in names if not key.endswith("_m")}
    landmark = Landmark(**texts, **numbers)  # type: ignore[arg-type] # keys are split by type above
    if not (landmark.width_m > 0.0 and 0.0 <= landmark.band_bottom_m < landmark.band_top_m):
        raise ConfigError(where, key="row", value=line, expected="width > 0 and 0 <= bottom < top")
    return landmark


def _metres(where: Where, key: str, value: str) -> float:
    try:
        metres = float(value)
    except ValueError:
        metres = math.nan
    if not math.isfinite(metres):
        raise ConfigError(where, key=key, value=value, expected="a finite number of metres")
    return metres


def _refuse_twins(landmarks: tuple[Landmark, ...], file: str) -> None:
    seen: set[str] = set()
    for landmark in landmarks:
        if landmark.name in seen:
            raise ConfigError(
                Where(file), key="name", value=landmark.name, expected="each name only once"
            )
        seen.add(landmark.name)
