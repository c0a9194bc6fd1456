"""Rows of the comparison, and one real drive with a lens that hangs from the mast."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.config.camera_file import read_camera_files
from catoptra_studies.cameras.camera_stage import CameraStage, open_stage, stage_cameras
from catoptra_studies.cameras.compare_command import (
    NO_DRIVES,
    DrivePlan,
    compare_cameras,
    make_row,
)
from helpers.configs import FIELD


def test_row_has_the_resolution_at_the_floor_and_at_the_horizon(stage: CameraStage) -> None:
    row = make_row(stage.cameras[1], NO_DRIVES, 2.0)
    px_per_deg = 60 / 220
    assert row.floor_radial == pytest.approx(px_per_deg)
    assert row.horizon_tangential == pytest.approx(px_per_deg * 0.5 * math.pi)
    theta_deg = math.degrees(math.atan2(3.0, 0.6))
    expected = px_per_deg * theta_deg / math.degrees(math.sin(math.radians(theta_deg)))
    assert row.floor_tangential == pytest.approx(expected, rel=1e-6)


def test_comparison_without_runs_drives_nothing(stage: CameraStage, tmp_path: Path) -> None:
    plan = DrivePlan(FIELD, stage.landmarks, num_runs=0, seed=0, folder=tmp_path)
    rows = compare_cameras(stage, plan, num_timed=1, on_camera=lambda: None)
    assert [row.name for row in rows] == ["paper", "equidistant_220"]
    assert all(np.isnan(row.drives.ekf_median_m) for row in rows)


def test_hanging_lens_localizes_the_robot(tmp_path: Path) -> None:
    cameras = stage_cameras(read_camera_files(["equidistant_220"]), tmp_path, size_px=360)
    with open_stage(cameras, FIELD) as stage:
        plan = DrivePlan(FIELD, stage.landmarks, num_runs=1, seed=0, folder=tmp_path)
        (row,) = compare_cameras(stage, plan, num_timed=1, on_camera=lambda: None)
    # The paper's mirror at 360 px has 0.10 m, odometry alone more than 1 m.
    assert row.drives.ekf_p90_m < 0.2
    assert row.drives.steps_with_landmarks > 0.95
