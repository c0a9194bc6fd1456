"""The command `catoptra-studies compare`: rows, one real drive with a lens, table and picture."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.config.camera_file import read_camera_files
from catoptra_studies.cameras import compare_command
from catoptra_studies.cameras.camera_stage import CameraStage, open_stage
from catoptra_studies.cameras.compare_command import (
    NO_DRIVES,
    CameraRow,
    DriveMetrics,
    DrivePlan,
    compare_cameras,
    format_comparison,
    make_row,
    write_comparison,
)
from helpers.configs import FIELD


def test_world_without_landmarks_is_compared_without_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--cameras", "paper", "--world", "incidence_rings", "--size", "60", "--frames", "1"]
    assert compare_command.main([*words, "--output", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "no landmarks" in printed
    assert (tmp_path / "comparison.csv").exists()


def test_unknown_world_ends_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--cameras", "paper", "--world", "moon", "--output", str(tmp_path)]
    assert compare_command.main(words) == 2
    assert "moon" in capsys.readouterr().err


def test_row_has_the_resolution_at_the_floor_and_at_the_horizon(stage: CameraStage) -> None:
    row = make_row(stage.cameras[1], NO_DRIVES, 2.0)
    px_per_deg = 60 / 220
    assert row.floor_radial == pytest.approx(px_per_deg)
    assert row.horizon_tangential == pytest.approx(px_per_deg * 0.5 * math.pi)
    theta_deg = math.degrees(math.atan2(3.0, 0.6))
    expected = px_per_deg * theta_deg / math.degrees(math.sin(math.radians(theta_deg)))
    assert row.floor_tangential == pytest.approx(expected, rel=1e-6)


def test_comparison_without_runs_drives_nothing(stage: CameraStage, tmp_path: Path) -> None:
    plan = DrivePlan(num_runs=0, seed=0, folder=tmp_path)
    rows = compare_cameras(stage, plan, num_timed=1, on_camera=lambda: None)
    assert [row.name for row in rows] == ["paper", "equidistant_220"]
    assert all(np.isnan(row.drives.ekf_median_m) for row in rows)


def test_hanging_lens_localizes_the_robot(tmp_path: Path) -> None:
    files = read_camera_files(["equidistant_220"])
    with open_stage(files, FIELD, tmp_path, size_px=360) as stage:
        plan = DrivePlan(num_runs=1, seed=0, folder=tmp_path)
        (row,) = compare_cameras(stage, plan, num_timed=1, on_camera=lambda: None)
    # The paper's mirror at 360 px has 0.10 m, odometry alone more than 1 m.
    assert row.drives.ekf_p90_m < 0.2
    assert row.drives.steps_with_landmarks > 0.95


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
