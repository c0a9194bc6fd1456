"""Results of the study as data and as cost.json, the source of report and plots.

Results know no types of the server. The Pareto front of time and error has the points that no
other point beats in both.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.camera_figures.frame_rates import FrameRate
from catoptra_studies.reports import replace_non_finite, write_json

# 3: conditions of frame rates. An older file is rejected, not translated: `make cost` writes a new
# one.
FORMAT_VERSION = 3
_RowT = TypeVar("_RowT")


@dataclass(frozen=True, slots=True)
class StudyConditions:
    """Circumstances under which the study was measured."""

    date: str

    machine: str
    """Processor, interpreter and the user's remark."""

    renderers: tuple[str, ...]
    """Description of each renderer that ran."""

    robot: str
    world: str

    size_px: int
    """Width and height of the image."""

    is_quick: bool
    """Whether few levels and frames were measured."""

    num_rounds: int
    """Timed frames of each level."""

    num_poses: int
    """Poses at which images are compared."""

    reference_samples: int
    """Samples along a pixel's side of the exact reference."""


@dataclass(frozen=True, slots=True)
class LevelCost:
    """Cost and error of one accuracy level."""

    name: str
    renderer: str

    num_polygons: int
    """Polygons of the mirror mesh; 0 where the camera model is evaluated in every pixel."""

    samples: int
    """Samples along a pixel's side."""

    face_size_px: int
    """Texels along the side of the largest face; 0 for trace."""

    is_key: bool
    """Whether localization was measured with frames of this level."""

    robot_ini: str
    """Sections of a robot file that select the level."""

    wall_ms: float
    """Median time of a frame with read-back."""

    cpu_ms: float
    """The same of all processors together."""

    stage_ms: dict[str, float]
    """Median time of each stage."""

    bound_max_px: float
    """Proved limit of the displacement (frames/plan/error_bound.py)."""

    bound_rms_px: float
    """Proved limit of the root mean square over the image."""

    bound_max_deg: float
    """Proved limit of the angle between shown and true direction."""

    rmse: float
    """Root mean square difference from the reference, in grey levels."""

    psnr_db: float
    ssim: float

    is_on_pareto_front: bool
    """Whether no other level beats this one in time and RMSE."""


@dataclass(frozen=True, slots=True)
class PolygonRow:
    """Displacement by one mirror mesh at the paper's image size."""

    num_polygons: int
    sectors: int
    rings: int

    interpolation: str
    """Quantity interpolated over a polygon: uv or position."""

    coverage: float
    """Fraction of the mirror's disc that the polygons cover."""

    rms_px: float
    max_px: float

    reference_rms_px: float
    """Value of the independent table; 0 for a mirror that is not in the table."""

    reference_max_px: float

    @property
    def agrees_with_reference(self) -> bool:
        """Whether rms and maximum agree with the table, within tolerances."""
        # With UV coordinates the maker of a mesh is free to choose the face of a quadrilateral and
        # its diagonal, which moves the error of large polygons by more than the table's rounding.
        rms, maximum = (0.15, 0.15) if self.interpolation == "uv" else (0.03, 0.05)
        return math.isclose(self.rms_px, self.reference_rms_px, rel_tol=rms) and math.isclose(
            self.max_px, self.reference_max_px, rel_tol=maximum
        )


@dataclass(frozen=True, slots=True)
class LocalizationRow:
    """Detection and localization with frames of one level; nan where none was measured."""

    level: str

    num_frames: int

    detection_rate: float
    """Fraction of the beacons within 2.5 m that were measured."""

    near_detection_rate: float
    """The same within 1.5 m."""

    bearing_rms_deg: float
    range_rms_m: float

    ekf_mean_m: float
    """Mean position error of a drive with the paper's filter; median over the drives."""

    ekf_max_m: float
    """Largest position error of a drive, likewise."""

    consistent_ekf_mean_m: float
    """`ekf_mean_m` of the filter with covariances that match the real errors."""

    consistent_ekf_max_m: float


@dataclass(frozen=True, slots=True)
class LocalizationAccuracy:
    """Localization by frames of the key levels."""

    num_runs: int
    """Drives for each level, with the same seeds for all levels."""

    steps_per_run: int

    odometry_max_m: float
    """Largest position error of odometry alone; median over the drives."""

    rows: tuple[LocalizationRow, ...]
    """One row for each key level, from coarse to exact."""


@dataclass(frozen=True, slots=True)
class CostResults:
    """All results of the study."""

    conditions: StudyConditions
    levels: tuple[LevelCost, ...]
    polygon_rows: tuple[PolygonRow, ...]
    frame_rates: tuple[FrameRate, ...]

    localization: LocalizationAccuracy | None = None
    """None until robots have been driven."""


def write_cost_results(results: CostResults, path: Path) -> None:
    """Write cost.json; null stands for inf and nan."""
    write_json(path, {"version": FORMAT_VERSION, **replace_non_finite(asdict(results))})


def read_cost_results(path: Path) -> CostResults:
    """Read cost.json.

    Raises:
        CatoptraError: The file is missing, is no JSON, or has another version or other fields.
    """
    try:
        return _parse_results(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CatoptraError(
            f"{path}: not a cost.json of version {FORMAT_VERSION} ({error!r}): measure again with "
            "catoptra-studies cost"
        ) from error


def _parse_results(entries: dict[str, Any]) -> CostResults:
    if entries["version"] != FORMAT_VERSION:
        raise ValueError(f"version {entries['version']}")
    # Missing as well as null: a study without drives may have either.
    localization = entries.get("localization")
    return CostResults(
        conditions=_parse_row(StudyConditions, entries["conditions"]),
        levels=tuple(_parse_row(LevelCost, row) for row in entries["levels"]),
        polygon_rows=tuple(_parse_row(PolygonRow, row) for row in entries["polygon_rows"]),
        frame_rates=tuple(_parse_row(FrameRate, row) for row in entries["frame_rates"]),
        localization=_parse_localization(localization) if localization else None,
    )


def _parse_localization(entries: dict[str, Any]) -> LocalizationAccuracy:
    rows = tuple(_parse_row(LocalizationRow, row) for row in entries["rows"])
    return _parse_row(LocalizationAccuracy, entries | {"rows": rows})


def _parse_row(row_class: type[_RowT], entry: Any) -> _RowT:
    """Make a row of a JSON object; unknown keys are ignored, missing ones raise TypeError."""
    if not isinstance(entry, dict):
        raise TypeError(f"{row_class.__name__} is {entry!r}")
    names = {field.name for field in fields(row_class)}  # type: ignore[arg-type] # all dataclasses
    # A newer writer may add fields, but must not remove any.
    values = {key: value for key, value in entry.items() if key in names}
    for key in (key for key, value in values.items() if value is None):
        # The PSNR of equal images is the only number that can be infinite.
        values[key] = math.inf if key == "psnr_db" else math.nan
    if "renderers" in values:
        values["renderers"] = tuple(values["renderers"])
    return row_class(**values)


# Medians of times differ by as much from run to run, so a smaller gain in error is no reason to
# pay for a slower level.
MIN_GAIN = 0.05


def pareto_front(
    points: Sequence[tuple[float, float]], *, min_gain: float = 0.0
) -> tuple[int, ...]:
    """Indices of the (time, error) points on the front, from fast to exact.

    A point is on the front if no other is at least as good in both and better in one; of equal
    points the first counts.

    Args:
        points: (time, error) of each candidate.
        min_gain: Fraction of the preceding error that a slower point must remove.
    """
    # Sorted by time, a point is on the front exactly if the last one has a larger error.
    order = sorted(range(len(points)), key=lambda index: (*points[index], index))
    front: list[int] = []
    for index in order:
        if not front or points[index][1] < (1.0 - min_gain) * points[front[-1]][1]:
            front.append(index)
    return tuple(front)
