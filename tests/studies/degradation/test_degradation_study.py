"""The study of degraded images over real sockets and processes: a short drive, two levels."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_server.config.robot_file import read_robot
from catoptra_server.effects import EffectMode
from catoptra_studies.cli import main
from catoptra_studies.degradation.degradation_report import write_degradation_results
from catoptra_studies.degradation.degradation_study import num_drives, run_degradation_study
from catoptra_studies.degradation.degradation_sweeps import (
    REAL_ROBOT,
    SWEEPS,
    DegradationSweep,
    clean_robot_ini,
    degraded_robot_ini,
)
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SIM
from helpers.configs import REPOSITORY

CONFIGS = REPOSITORY / "configs"
ROBOTS = CONFIGS / "robots"
DARK_SWEEP = DegradationSweep(
    "Dark",
    "ever less light",
    "exposure",
    ini_keys="Exposure=always|WhiteExposureTime=0.01",
    levels={"1": "ExposureTime=0.01", "0.001": "ExposureTime=0.00001"},
)


def test_study_when_images_are_black_detects_nothing_and_names_the_level(tmp_path: Path) -> None:
    config = ExperimentConfig(
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
        config, [DARK_SWEEP], robot_folder=ROBOTS, on_drive=lambda: done.append(None)
    )
    write_degradation_results(tmp_path, config, results)

    assert len(done) == num_drives(config, [DARK_SWEEP]) == 3
    (sweep,) = json.loads((tmp_path / "degradation.json").read_text())["sweeps"]
    same, black = (level["trained_on"]["clean"] for level in sweep["levels"])
    assert same == sweep["clean"]["trained_on"]["clean"]  # an exposure of 1 changes nothing
    assert same["num_frames"] == 4
    assert same["detection_rate"] > 0.8
    assert same["bearing_rms_deg"] < 0.5
    assert (black["num_visible"], black["num_detected"]) == (same["num_visible"], 0)
    assert sweep["failure_levels"]["clean"]["detection_below_50_percent"] == "0.001"
    assert "| Dark " in (tmp_path / "DEGRADATION.md").read_text()
    plots = {path.name for path in tmp_path.glob("*.png")}
    assert plots == {"degradation.png", "degradation_dark.png"}


@pytest.mark.parametrize("sweep", SWEEPS, ids=lambda sweep: sweep.slug)
def test_levels_when_read_by_the_server_select_their_effects(
    tmp_path: Path, sweep: DegradationSweep
) -> None:
    (tmp_path / "clean.ini").write_text(clean_robot_ini(ROBOTS))
    clean, _ = read_robot(tmp_path / "clean.ini")
    for keys in sweep.levels.values():
        (tmp_path / "level.ini").write_text(degraded_robot_ini(sweep, keys, ROBOTS))
        robot, file = read_robot(tmp_path / "level.ini")
        assert file.unknown_names() == []
        assert robot.omni_camera is not None
        assert clean.omni_camera is not None
        modes = {setting.mode for setting in robot.omni_camera.effects.settings}
        assert (EffectMode.AUTO if sweep.base_robot == REAL_ROBOT else EffectMode.ALWAYS) in modes
        assert robot.omni_camera.camera == clean.omni_camera.camera
        assert robot.sensors == clean.sensors
    assert [one.effect.name for one in clean.omni_camera.effects.settings] == ["SelfView"]


def test_configs_when_missing_are_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--configs", str(tmp_path / "none"), "--out", str(tmp_path))
    assert main(["effects", *arguments, "--quick", "--only", "sweeps"]) == 1
    assert "catoptra-studies effects: " in capsys.readouterr().err
