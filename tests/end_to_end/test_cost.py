"""The client's part of the study over real sockets and processes: one step, one run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from catoptra_server.render.render_plan import RendererKind, RenderSettings
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel, level_robot_ini
from catoptra_studies.accuracy_cost.localization_main import EXIT_FAILURE, main
from helpers.configs import REPOSITORY

CONFIGS = ("--configs", str(REPOSITORY / "configs"))


def test_landmarks_when_a_step_is_driven_stand_in_the_study(tmp_path: Path) -> None:
    step = AccuracyLevel(
        "1024 polygons",
        RendererKind.TRACE,
        RenderSettings(tessellation_from_polygon_count(1024), 1),
    )
    lines = level_robot_ini(step, 360)
    row = {"name": step.name, "renderer": "trace", "robot_lines": lines, "rmse": 9.0}
    study = {"version": 1, "steps": [{**row, "is_key": True}]}
    (tmp_path / "cost.json").write_text(json.dumps(study))

    assert main([*CONFIGS, "--output", str(tmp_path), "--quick"]) == 0

    read = json.loads((tmp_path / "cost.json").read_text())
    assert read["steps"] == study["steps"]
    landmarks = read["landmarks"]
    assert (landmarks["runs"], landmarks["steps_a_run"]) == (1, 100)
    (driven,) = landmarks["rows"]
    assert driven["step"] == "1024 polygons"
    assert driven["frames"] == 100
    assert driven["found_near"] > 0.9
    # 1024 polygons show things 0.75 px off (rms), a quarter of a degree of bearing.
    assert 0.1 < driven["bearing_rms_deg"] < 1.0
    assert driven["ekf_mean_m"] < 0.2 < landmarks["odometry_max_m"]
    log = "".join(path.read_text() for path in tmp_path.glob("server_*.log"))
    assert "32 x 32 polygons" in log


def test_study_when_missing_ends_with_a_message_and_no_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*CONFIGS, "--output", str(tmp_path)]) == EXIT_FAILURE
    assert "let catoptra-server cost measure first" in capsys.readouterr().err
