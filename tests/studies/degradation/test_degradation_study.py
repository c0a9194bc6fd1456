"""The study of degraded pictures over real sockets and processes: small, short, two rungs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_server.config.robot_file import read_robot
from catoptra_server.effects.effect import EffectMode
from catoptra_studies.degradation.degradation_study import num_drives, run_degradation_study
from catoptra_studies.degradation.degradation_sweeps import (
    REAL_ROBOT,
    SWEEPS,
    DegradationLevel,
    DegradationSweep,
    clean_robot_ini,
    degraded_robot_ini,
)
from catoptra_studies.effects.effects_command import EXIT_FAILURE, main, write_degradation_results
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SIM
from helpers.configs import REPOSITORY

CONFIGS = REPOSITORY / "configs"
ROBOTS = CONFIGS / "robots"
DARK_EFFECTS = DegradationSweep(
    "Dark",
    "ever less light",
    "exposure",
    ini_keys="Exposure=always|WhiteExposureTime=0.01",
    levels=(
        DegradationLevel("1", "ExposureTime=0.01"),
        DegradationLevel("0.001", "ExposureTime=0.00001"),
    ),
)


def test_study_when_pictures_are_black_finds_nothing_and_says_where(tmp_path: Path) -> None:
    plan = ExperimentConfig(
        config_folder=CONFIGS,
        output_folder=tmp_path,
        setups=(replace(SIM, route=SIM.route[:5]),),
        num_runs=1,
        seed=0,
        num_training_frames=4,
        server_arguments=("--renderer", "trace", "--threads", "1"),
    )
    done: list[None] = []
    results = run_degradation_study(
        plan, [DARK_EFFECTS], robot_folder=ROBOTS, on_drive=lambda: done.append(None)
    )
    write_degradation_results(tmp_path, plan, results)

    assert len(done) == num_drives(plan, [DARK_EFFECTS]) == 3
    (ladder,) = json.loads((tmp_path / "degraded.json").read_text())["ladders"]
    same, black = (rung["taught"]["clean"] for rung in ladder["rungs"])
    assert same == ladder["clean"]["taught"]["clean"]  # an exposure of 1 changes nothing
    assert same["frames"] == 4
    assert same["rate"] > 0.8
    assert same["bearing_rms_deg"] < 0.5
    assert (black["visible"], black["found"]) == (same["visible"], 0)
    assert ladder["verdicts"]["clean"]["fails"] == "0.001"
    assert "| Dark | exposure |" in (tmp_path / "DEGRADED.md").read_text()
    assert {path.name for path in tmp_path.glob("*.png")} == {"degraded.png", "degraded_dark.png"}


@pytest.mark.parametrize("ladder", SWEEPS, ids=lambda ladder: ladder.slug)
def test_rungs_when_read_by_the_server_ask_for_their_effects(
    tmp_path: Path, ladder: DegradationSweep
) -> None:
    (tmp_path / "clean.ini").write_text(clean_robot_ini(ROBOTS))
    clean, _ = read_robot(tmp_path / "clean.ini")
    for rung in ladder.levels:
        (tmp_path / "rung.ini").write_text(degraded_robot_ini(ladder, rung, ROBOTS))
        robot, file = read_robot(tmp_path / "rung.ini")
        assert file.unknown_entries() == []
        assert robot.omni_camera is not None
        assert clean.omni_camera is not None
        modes = {wish.mode for wish in robot.omni_camera.effects.settings}
        assert (EffectMode.AUTO if ladder.base_robot == REAL_ROBOT else EffectMode.ALWAYS) in modes
        assert robot.omni_camera.camera == clean.omni_camera.camera
        assert robot.sensors == clean.sensors
    assert clean.omni_camera.effects.settings == ()


def test_configs_when_missing_end_with_a_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--configs", str(tmp_path / "none"), "--output", str(tmp_path), "--quick")
    assert main(arguments) == EXIT_FAILURE
    assert "degraded: " in capsys.readouterr().err
