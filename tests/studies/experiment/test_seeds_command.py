"""A seed without pictures has the numbers of `demo`; the report of many seeds pools shares."""

from __future__ import annotations

import json

import pytest

from catoptra_studies.experiment import demo_command, seeds_command
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SETUPS
from catoptra_studies.experiment.paper_claims import Claim, RunShare
from catoptra_studies.experiment.seeds_command import SeedResult, format_seeds_report

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


def make_result(seed: int, satisfying: int) -> SeedResult:
    claim = Claim("sim_gate", "sim: they pass", "one passes", RunShare(satisfying, 20))
    untypical = Claim("real_growth", "real: it grows", "above 0.3 m", RunShare(1, 20))
    return SeedResult(seed, (claim,), (untypical,))


def test_status_is_that_of_claims_alone():
    assert make_result(0, 11).status == 0
    assert make_result(0, 10).status == 1


def test_report_has_shares_intervals_and_seeds():
    text = format_seeds_report([make_result(0, 20), make_result(1, 16)], num_runs=20)
    assert "ends with status 0 with every seed" in " ".join(text.split())
    row = next(line for line in text.splitlines() if "one passes" in line)
    assert [cell.strip() for cell in row.split("|")][2:6] == [
        "90.0%", "76.9% to 96.0%", "16 of 20", "2 of 2"
    ]  # fmt: skip
    assert "| 1    |       16 |           1 |      0 |" in text


def test_report_names_the_seeds_that_fail():
    results = [make_result(seed, satisfying) for seed, satisfying in enumerate((20, 9, 10))]
    assert "status 1 with the seeds 1, 2" in " ".join(
        format_seeds_report(results, num_runs=20).split()
    )
