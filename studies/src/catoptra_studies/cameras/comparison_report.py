"""Table and picture of a comparison: Markdown for the terminal, CSV, JSON and PNG."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from catoptra_studies import plot_style
from catoptra_studies.cameras.camera_comparison import FLOOR_DISTANCE_M, CameraRow
from catoptra_studies.reports import format_number, markdown_table

# Key of a flat row and its label.
_COLUMNS = {
    "covered_sphere": "covered sphere",
    "floor_radial": f"px/deg at {FLOOR_DISTANCE_M:g} m",
    "floor_tangential": "across",
    "horizon_radial": "px/deg at horizon",
    "horizon_tangential": "across",
    "blind_radius_m": "blind zone, m",
    "floor_reach_m": "floor seen to, m",
    "ekf_median_m": "EKF median, m",
    "ekf_p90_m": "EKF 90 %, m",
    "consistent_median_m": "consistent EKF median, m",
    "consistent_p90_m": "90 %, m",
    "steps_with_landmarks": "steps with landmarks",
    "frame_ms": "ms a frame",
}
# Panels of the picture: key, title.
_PANELS = (
    ("floor_radial", f"px per degree, floor at {FLOOR_DISTANCE_M:g} m"),
    ("horizon_tangential", "px per degree of bearing at the horizon"),
    ("blind_radius_m", "blind zone: radius of floor not seen, m"),
    ("ekf_p90_m", "position error, 90 % of the steps, m"),
    ("steps_with_landmarks", "fraction of steps with landmarks"),
    ("frame_ms", "processor time of a frame, ms"),
)  # fmt: skip


def flatten_row(row: CameraRow) -> dict[str, str | float]:
    """One level of keys, in the order of the table."""
    values = asdict(row)
    values |= values.pop("drives")
    return {"camera": row.name} | {key: values[key] for key in _COLUMNS}


def format_comparison(rows: Sequence[CameraRow]) -> str:
    """Markdown table; a dash where a camera does not show an angle or has not been driven."""
    cells = [
        [row.name, *(format_number(float(value)) for value in [*flatten_row(row).values()][1:])]
        for row in rows
    ]
    return markdown_table(["camera", *_COLUMNS.values()], cells)


def write_comparison(rows: Sequence[CameraRow], folder: Path) -> None:
    """Write comparison.csv, comparison.json and comparison.png; no number is null in JSON."""
    flat = [flatten_row(row) for row in rows]
    with (folder / "comparison.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ["camera", *_COLUMNS])
        writer.writeheader()
        writer.writerows(flat)
    document = [{key: _finite_or_none(value) for key, value in row.items()} for row in flat]
    text = json.dumps(document, indent=2, allow_nan=False)
    (folder / "comparison.json").write_text(text + "\n", encoding="utf-8")
    _draw_comparison(flat, folder / "comparison.png")


def _finite_or_none(value: str | float) -> str | float | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _draw_comparison(flat: Sequence[dict[str, str | float]], path: Path) -> None:
    size = (plot_style.PAGE_WIDTH_IN, 1.0 + 0.75 * len(flat))
    with plot_style.open_chart(path, figsize=size) as figure:
        names = [str(row["camera"]) for row in flat]
        for axes, (key, title) in zip(
            figure.subplots(3, 2, sharey=True).flat, _PANELS, strict=True
        ):
            values = [float(row[key]) for row in flat]
            widths = [value if math.isfinite(value) else 0.0 for value in values]
            axes.barh(names, widths, color=plot_style.BLUE, height=0.6)
            for place, value in enumerate(values):
                label = "-" if math.isnan(value) else format_number(value)
                axes.annotate(label, (widths[place], place), (3, 0), textcoords="offset points",
                              va="center", fontsize=7)  # fmt: skip
            axes.set_title(title)
            axes.margins(x=0.15)
            axes.set_xlim(left=0.0)
            axes.grid(visible=False, axis="y")
        # Shared by all panels: the first camera is at the top.
        axes.invert_yaxis()
