"""What the study measured, as data and as cost.json: the report and the pictures are made of it.

The client's side adds `landmarks`: what the frames of the key steps are worth to a program that
finds landmarks in them and localises the robot by them.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

from catoptra_protocol.errors import CatoptraError

FORMAT_VERSION = 1
RowT = TypeVar("RowT")


@dataclass(frozen=True, slots=True)
class StudyConditions:
    """What was measured on what. rounds: frames of each step; poses: places they are seen from."""

    date: str
    machine: str
    renderers: tuple[str, ...]
    robot: str
    world: str
    size_px: int
    is_quick: bool
    num_rounds: int
    num_poses: int
    reference_samples: int


@dataclass(frozen=True, slots=True)
class LevelCost:
    """A step of the ladder: what it is, what it costs, how far off it is.

    polygons: 0 = per pixel. bound_*: of planning/error_bound. rmse in grey levels, psnr_db, ssim:
    against the supersampled trace. robot_lines: of a robot file that asks for it.
    """

    name: str
    renderer: str
    num_polygons: int
    samples: int
    face_size_px: int
    is_key: bool
    robot_ini: str
    wall_ms: float
    cpu_ms: float
    stage_ms: dict[str, float]
    bound_max_px: float
    bound_rms_px: float
    bound_max_deg: float
    rmse: float
    psnr_db: float
    ssim: float
    is_on_pareto_front: bool


@dataclass(frozen=True, slots=True)
class PolygonRow:
    """A polygon mirror's displacement at the paper's size, measured and by the reference table."""

    num_polygons: int
    sectors: int
    rings: int
    interpolation: str
    coverage: float
    rms_px: float
    max_px: float
    reference_rms_px: float
    reference_max_px: float


@dataclass(frozen=True, slots=True)
class FrameRate:
    """A bar of Figure 10: what a robot carries, and what a frame of the whole then takes.

    polygons: of the camera's mirror; 0 where it carries none, or an exact one.
    """

    world: str
    renderer: str
    payload: str
    num_polygons: int
    fps: float
    wall_ms: float
    cpu_ms: float
    stage_ms: dict[str, float]


@dataclass(frozen=True, slots=True)
class LocalizationRow:
    """What the frames of a step are worth: landmarks found while driving, and where they put it.

    found: share of the beacons within reach that were measured. *_rms_*: of the measurements.
    ekf_*: medians over the runs of the mean position error, by the paper's filter and by one whose
    noises are honest.
    """

    level: str
    num_frames: int
    detection_rate: float
    near_detection_rate: float
    bearing_rms_deg: float
    range_rms_m: float
    ekf_mean_m: float
    ekf_max_m: float
    consistent_ekf_mean_m: float
    consistent_ekf_max_m: float


@dataclass(frozen=True, slots=True)
class LocalizationAccuracy:
    """The client's part. renderer: that it was measured through; odometry_max_m: without eyes."""

    num_runs: int
    steps_per_run: int
    odometry_max_m: float
    rows: tuple[LocalizationRow, ...]


@dataclass(frozen=True, slots=True)
class CostResults:
    """All that the study knows."""

    conditions: StudyConditions
    levels: tuple[LevelCost, ...]
    polygon_rows: tuple[PolygonRow, ...]
    frame_rates: tuple[FrameRate, ...]
    localization: LocalizationAccuracy | None = None


def write_cost_results(results: CostResults, path: Path) -> None:
    """Write cost.json. JSON has no infinity: the PSNR of equal pictures is null."""
    text = json.dumps({"version": FORMAT_VERSION, **_replace_non_finite(asdict(results))}, indent=2)
    path.write_text(text + "\n", encoding="utf-8")


def _replace_non_finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _replace_non_finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_non_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_cost_results(path: Path) -> CostResults:
    """Return what cost.json holds. Raises CatoptraError for a file that is not one."""
    try:
        read = json.loads(path.read_text(encoding="utf-8"))
        return _parse_results(read)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CatoptraError(
            f"{path}: not a cost.json of version {FORMAT_VERSION} ({error!r}): measure anew with "
            "catoptra-server cost"
        ) from error


def _parse_results(entries: dict[str, Any]) -> CostResults:
    if entries["version"] != FORMAT_VERSION:
        raise ValueError(f"version {entries['version']}")
    return CostResults(
        conditions=_parse_row(StudyConditions, entries["conditions"]),
        levels=tuple(_parse_row(LevelCost, row) for row in entries["steps"]),
        polygon_rows=tuple(_parse_row(PolygonRow, row) for row in entries["polygons"]),
        frame_rates=tuple(_parse_row(FrameRate, row) for row in entries["frame_rates"]),
        localization=_parse_localization(entries["landmarks"])
        if entries.get("landmarks")
        else None,
    )


def _parse_localization(entries: dict[str, Any]) -> LocalizationAccuracy:
    rows = tuple(_parse_row(LocalizationRow, row) for row in entries["rows"])
    return _parse_row(LocalizationAccuracy, entries | {"rows": rows})


def _parse_row(row_class: type[RowT], entry: Any) -> RowT:
    """Return a row; unknown keys are left out, missing ones fail."""
    if not isinstance(entry, dict):
        raise TypeError(f"{row_class.__name__} is {entry!r}")
    names = {field.name for field in fields(row_class)}  # type: ignore[arg-type] # all are dataclasses
    known = {key: value for key, value in entry.items() if key in names}
    for key in (key for key, value in known.items() if value is None):
        known[key] = math.inf if key == "psnr_db" else math.nan
    if "renderers" in known:
        known["renderers"] = tuple(known["renderers"])
    return row_class(**known)
