"""Localization with frames of a level: rates and errors of made runs, and one real run."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from catoptra_client.localization import OdometryPose
from catoptra_protocol.landmarks import Landmark
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies.accuracy_cost import localization_study
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel, level_robot_ini
from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.cost_study import CostStudyConfig
from catoptra_studies.accuracy_cost.localization_study import (
    measure_localization,
    select_key_levels,
    summarize_localization,
)
from catoptra_studies.commands import open_progress
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.experiment_runner import SetupResult
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.experiment.route import Waypoint
from helpers.configs import FIELD, OMNI_ROBOT


def test_localization_when_a_level_is_driven_uses_frames_of_that_level(
    results: CostResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A third of the route: the whole one is driven in experiment/test_experiment_runner.py.
    monkeypatch.setattr(localization_study, "SIM", replace(SIM, route=SIM.route[:36]))
    monkeypatch.setattr(localization_study, "_NUM_TRAINING_FRAMES", 12)
    settings = RenderSettings(tessellation_from_polygon_count(1024), 1)
    level = AccuracyLevel("1024 polygons", RendererKind.TRACE, settings)
    ini = level_robot_ini(level, 360)
    cost = replace(results.levels[0], name=level.name, renderer="trace", robot_ini=ini)
    config = CostStudyConfig(
        robot_file=OMNI_ROBOT,
        world_files=(FIELD,),
        size_px=360,
        is_quick=True,
        output_folder=tmp_path,
        date="",
        machine="",
    )
    with open_progress(is_visible=False) as progress:
        localization = measure_localization(config, [cost], progress)

    assert (localization.num_runs, localization.steps_per_run) == (1, 35)
    (row,) = localization.rows
    assert (row.level, row.num_frames) == ("1024 polygons", 35)
    assert row.near_detection_rate > 0.9
    # 1024 polygons displace the image by 0.75 px (rms), a quarter of a degree of bearing.
    assert 0.1 < row.bearing_rms_deg < 1.0
    assert row.ekf_mean_m < 0.2 < localization.odometry_max_m
    log = "".join(path.read_text() for path in tmp_path.glob("server_*.log"))
    assert "32 x 32 polygons" in log


def test_key_levels_are_sorted_from_coarse_to_exact(results: CostResults) -> None:
    other = replace(results.levels[0], name="other", is_key=False)
    levels = select_key_levels([*results.levels, other])
    assert [level.rmse for level in levels] == [25.0, 6.1, 3.7]


NEAR = Landmark("near", "beacon", 1.0, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")
FAR = Landmark("far", "beacon", 0.0, 2.0, 0.1, 0.1, 0.2, 0.4, "magenta", "cyan")
HERE = DriveStep(Waypoint(0.0, 0.0, 0.0), OdometryPose(0.0, 0.0, 0.0), ())


def make_result(*measurements: tuple[LandmarkMeasurement, ...]) -> SetupResult:
    steps = (HERE, *(DriveStep(HERE.truth, HERE.odometry, found) for found in measurements))
    traces = {
        "paper": (
            make_filter_run([0.0, 0.1, 0.3]),
            make_filter_run([0.0, 0.2, 0.2]),
            make_filter_run([0.0, 0.9, 0.9]),
        ),
        "consistent": (make_filter_run([0.0, 0.1, 0.1]),),
    }
    return SetupResult(SIM, (DriveLog("sim", 0, steps),), traces)


def make_filter_run(errors_m: list[float]) -> FilterRun:
    """The fields of a run that the row needs; odometry has twice the error."""
    errors = np.array(errors_m)
    known = SimpleNamespace(estimate_error_m=errors, odometry_error_m=2.0 * errors)
    return cast(FilterRun, known)


def test_rows_have_rates_errors_and_medians_over_the_runs() -> None:
    seen = (LandmarkMeasurement("near", 1.03, math.radians(4.0)),)
    found = summarize_localization(
        {"a step": make_result(seen, ()), "blind": make_result(())}, (NEAR, FAR)
    )
    assert (found.num_runs, found.steps_per_run) == (3, 2)
    assert found.odometry_max_m == pytest.approx(0.6)  # twice the median of 0.3, 0.2, 0.9
    row, blind = found.rows
    assert (row.level, row.num_frames) == ("a step", 2)
    assert (row.near_detection_rate, row.detection_rate) == (0.5, 0.25)
    assert row.range_rms_m == pytest.approx(0.03)
    assert row.bearing_rms_deg == pytest.approx(4.0)
    assert row.ekf_mean_m == pytest.approx(0.2)  # of 0.2, 0.2 and 0.9
    assert row.ekf_max_m == pytest.approx(0.3)
    assert row.consistent_ekf_mean_m == pytest.approx(0.1)
    assert (blind.level, blind.detection_rate) == ("blind", 0.0)
    assert math.isnan(blind.range_rms_m)
    assert math.isnan(blind.bearing_rms_deg)
