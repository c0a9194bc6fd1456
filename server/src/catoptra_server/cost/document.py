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

VERSION = 1
Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class Conditions:
    """What was measured on what. rounds: frames of each step; poses: places they are seen from."""

    date: str
    machine: str
    renderers: tuple[str, ...]
    robot: str
    world: str
    size_px: int
    is_quick: bool
    rounds: int
    poses: int
    reference_samples: int


@dataclass(frozen=True, slots=True)
class StepCost:
    """A step of the ladder: what it is, what it costs, how far off it is.

    polygons: 0 = per pixel. bound_*: of plan/error_bound. rmse in grey levels, psnr_db, ssim:
    against the supersampled trace. robot_lines: of a robot file that asks for it.
    """

    name: str
    renderer: str
    polygons: int
    samples: int
    face_size_px: int
    is_key: bool
    robot_lines: str
    ms: float
    processor_ms: float
    stage_ms: dict[str, float]
    bound_max_px: float
    bound_rms_px: float
    bound_max_deg: float
    rmse: float
    psnr_db: float
    ssim: float
    is_on_front: bool


@dataclass(frozen=True, slots=True)
class PolygonRow:
    """A polygon mirror's displacement at the paper's size, measured and by the reference table."""

    polygons: int
    sectors: int
    rings: int
    interpolation: str
    covered: float
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
    carries: str
    polygons: int
    fps: float
    ms: float
    processor_ms: float
    stage_ms: dict[str, float]


@dataclass(frozen=True, slots=True)
class LandmarkRow:
    """What the frames of a step are worth: landmarks found while driving, and where they put it.

    found: share of the beacons within reach that were measured. *_rms_*: of the measurements.
    ekf_*: medians over the runs of the mean position error, by the paper's filter and by one whose
    noises are honest.
    """

    step: str
    frames: int
    found: float
    found_near: float
    bearing_rms_deg: float
    range_rms_m: float
    ekf_mean_m: float
    ekf_max_m: float
    honest_ekf_mean_m: float
    honest_ekf_max_m: float


@dataclass(frozen=True, slots=True)
class Landmarks:
    """The client's part. renderer: that it was measured through; odometry_max_m: without eyes."""

    runs: int
    steps_a_run: int
    odometry_max_m: float
    rows: tuple[LandmarkRow, ...]


@dataclass(frozen=True, slots=True)
class Document:
    """All that the study knows."""

    conditions: Conditions
    steps: tuple[StepCost, ...]
    polygons: tuple[PolygonRow, ...]
    frame_rates: tuple[FrameRate, ...]
    landmarks: Landmarks | None = None


def write_document(document: Document, path: Path) -> None:
    """Write cost.json. JSON has no infinity: the PSNR of equal pictures is null."""
    text = json.dumps({"version": VERSION, **_finite(asdict(document))}, indent=2)
    path.write_text(text + "\n", encoding="utf-8")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_document(path: Path) -> Document:
    """Return what cost.json holds. Raises CatoptraError for a file that is not one."""
    try:
        read = json.loads(path.read_text(encoding="utf-8"))
        return _document(read)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CatoptraError(
            f"{path}: not a cost.json of version {VERSION} ({error!r}): measure anew with "
            "catoptra-server cost"
        ) from error


def _document(read: dict[str, Any]) -> Document:
    if read["version"] != VERSION:
        raise ValueError(f"version {read['version']}")
    return Document(
        conditions=_row(Conditions, read["conditions"]),
        steps=tuple(_row(StepCost, row) for row in read["steps"]),
        polygons=tuple(_row(PolygonRow, row) for row in read["polygons"]),
        frame_rates=tuple(_row(FrameRate, row) for row in read["frame_rates"]),
        landmarks=_landmarks(read["landmarks"]) if read.get("landmarks") else None,
    )


def _landmarks(read: dict[str, Any]) -> Landmarks:
    rows = tuple(_row(LandmarkRow, row) for row in read["rows"])
    return _row(Landmarks, read | {"rows": rows})


def _row(kind: type[Row], read: Any) -> Row:
    """Return a row; unknown keys are left out, missing ones fail."""
    if not isinstance(read, dict):
        raise TypeError(f"{kind.__name__} is {read!r}")
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type] # all are dataclasses
    known = {key: value for key, value in read.items() if key in names}
    for key in (key for key, value in known.items() if value is None):
        known[key] = math.inf if key == "psnr_db" else math.nan
    if "renderers" in known:
        known["renderers"] = tuple(known["renderers"])
    return kind(**known)
