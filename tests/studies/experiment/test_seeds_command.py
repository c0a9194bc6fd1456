"""A seed without pictures has the numbers of `demo` with that seed.

Five seconds for the comparison, since both drive both set-ups.
"""

from __future__ import annotations

import json

import pytest

from catoptra_studies.experiment import demo_command, seeds_command
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SETUPS
from studies.experiment.test_seeds_report import make_result

SEED, RUNS, TRAINING_FRAMES = 7, 1, 12


@pytest.mark.long
def test_seed_has_the_numbers_of_demo(tmp_path, capsys):
    config = ExperimentConfig(
        None, tmp_path, setups=SETUPS, num_runs=RUNS, seed=0, num_training_frames=TRAINING_FRAMES
    )
    result = seeds_command.evaluate_experiment(config, SEED)
    status = demo_command.main(
        [
            *("--output", str(tmp_path / "demo"), "--figures", "none", "--seed", str(SEED)),
            *("--runs", str(RUNS), "--training-frames", str(TRAINING_FRAMES)),
        ]
    )
    demo = json.loads((tmp_path / "demo" / "summary.json").read_text())
    seed = json.loads((tmp_path / f"seed_{SEED}" / "summary.json").read_text())
    # What demo has besides: the times, and the camera's figures.
    assert seed == {key: demo[key] for key in seed}
    assert set(demo) - set(seed) == {"camera_metrics", "camera_timings", "timing_s"}
    assert status == result.status


@pytest.mark.parametrize(("satisfying", "status"), [((20, 11), 0), ((20, 10), 1)])
def test_command_ends_with_the_status_of_the_worst_seed(
    tmp_path, monkeypatch, capsys, satisfying, status
):
    results = [make_result(seed, runs) for seed, runs in enumerate(satisfying)]
    monkeypatch.setattr(seeds_command, "_run_seeds", lambda *arguments: results)
    assert seeds_command.main(["--output", str(tmp_path), "--seeds", "2"]) == status
    assert "sim_gate" in (tmp_path / "seeds.md").read_text(encoding="utf-8")
