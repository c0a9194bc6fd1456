"""Localization with frames of a level over real sockets and processes: one level, one run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies.accuracy_cost import localization_study
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel, level_robot_ini
from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.cost_study import CostStudyConfig
from catoptra_studies.accuracy_cost.localization_study import (
    measure_localization,
    select_key_levels,
    write_robot_file,
)
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.progress_display import open_progress
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


def test_robot_file_is_based_on_another_and_selects_the_level(
    results: CostResults, tmp_path: Path
) -> None:
    level = replace(results.levels[0], robot_ini="[Catoptra.OmniCaptureCamera]\nSamples=3\n")
    write_robot_file(level, tmp_path / "base.ini", tmp_path / "robot.ini")
    assert (tmp_path / "robot.ini").read_text() == (
        f"[Configuration]\nBasedOn={tmp_path.resolve() / 'base.ini'}\n"
        "[Catoptra.OmniCaptureCamera]\nSamples=3\n"
    )
