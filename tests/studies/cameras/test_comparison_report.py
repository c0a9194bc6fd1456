"""Table, CSV, JSON and picture of invented results."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

from catoptra_studies.cameras.compare_command import (
    NO_DRIVES,
    CameraRow,
    DriveMetrics,
    format_comparison,
    write_comparison,
)

ROWS = (
    CameraRow("paper", 0.75, 1.5, 1.6, 1.8, 1.9, 0.0, math.inf,
              DriveMetrics(0.06, 0.1, 0.03, 0.07, 1.0), 5.0),
    CameraRow("narrow", 0.45, 0.6, 3.1, math.nan, math.nan, 0.0, 6.86, NO_DRIVES, 4.0),
)  # fmt: skip


def test_table_has_a_line_for_each_camera_and_dashes_for_no_value() -> None:
    *_, paper, narrow = format_comparison(ROWS).splitlines()
    assert paper.startswith("| paper")
    assert narrow.count(" - ") == 7
    assert "6.86" in narrow


def test_files_have_the_numbers_of_the_table(tmp_path: Path) -> None:
    write_comparison(ROWS, tmp_path)
    document = json.loads((tmp_path / "comparison.json").read_text())
    assert document[0]["ekf_p90_m"] == 0.1
    assert document[1]["horizon_radial"] is None
    with (tmp_path / "comparison.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["camera"] for row in rows] == ["paper", "narrow"]
    assert float(rows[1]["floor_tangential"]) == 3.1
    assert (tmp_path / "comparison.png").stat().st_size > 5000
