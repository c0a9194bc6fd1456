"""A seed without pictures has the numbers of `demo`; the report of many seeds pools shares."""

from __future__ import annotations

import json

import pytest

from catoptra_studies.cli import main
from catoptra_studies.experiment import demo_command, seeds_command
from catoptra_studies.experiment.paper_claims import Claim
from catoptra_studies.experiment.seeds_command import SeedResult
from catoptra_studies.reports import write_json
from catoptra_studies.run_statistics import RunShare
from studies.experiment.test_paper_claims import make_setups


@pytest.mark.long
def test_seed_has_the_numbers_of_demo(tmp_path, capsys):
    extent = ("--runs", "1", "--training-frames", "12", "--out", str(tmp_path))
    # Seed 1: a seed that is not passed on would be 0.
    seeds_status = seeds_command.main([*extent, "--seeds", "2"])
    demo_status = demo_command.main([*extent, "--figures", "none", "--seed", "1"])
    demo = json.loads((tmp_path / "summary.json").read_text())
    seed = json.loads((tmp_path / "seed_1" / "summary.json").read_text())
    # What demo has besides: the times, and the camera's figures.
    assert seed == {key: demo[key] for key in seed}
    assert set(demo) - set(seed) == {"camera_metrics", "camera_timings", "timing_s"}
    assert seeds_status >= demo_status
    row = (tmp_path / "seeds.md").read_text(encoding="utf-8").splitlines()[-1]
    assert row.endswith(f" {demo_status} |")


def make_result(seed: int, satisfying: int) -> SeedResult:
    claim = Claim("sim_gate", "sim: they pass", "one passes", RunShare(satisfying, 20))
    # Counted in the report, and not in the status.
    untypical = Claim("real_growth", "real: it grows", "above 0.3 m", RunShare(1, 20))
    return SeedResult(seed, (claim,), (untypical,))


@pytest.fixture
def run_seeds(tmp_path, monkeypatch):
    """Run the command with invented results; returns its status and the report."""

    def run(*satisfying: int) -> tuple[int, str]:
        results = [make_result(seed, runs) for seed, runs in enumerate(satisfying)]
        monkeypatch.setattr(seeds_command, "_run_seeds", lambda *arguments: results)
        status = seeds_command.main(["--out", str(tmp_path), "--seeds", "2"])
        return status, (tmp_path / "seeds.md").read_text(encoding="utf-8")

    return run


@pytest.mark.parametrize(
    ("satisfying", "status", "ending"),
    [
        ((20, 6), 0, "ends with status 0 with every seed"),
        ((20, 5, 0), 1, "ends with status 1 with the seeds 1, 2"),
    ],
)
def test_command_ends_with_the_status_of_the_worst_seed_and_names_those_that_fail(
    run_seeds, satisfying, status, ending
):
    ended, text = run_seeds(*satisfying)
    assert ended == status
    assert ending in " ".join(text.split())


def test_report_has_shares_intervals_and_seeds(run_seeds):
    _, text = run_seeds(20, 14)
    row = next(line for line in text.splitlines() if "one passes" in line)
    assert [cell.strip() for cell in row.split("|")][2:6] == [
        "85.0%", "70.9% to 92.9%", "14 of 20", "1, 1, 0"
    ]  # fmt: skip
    assert "| 1    |       14 |           1 |      0 |" in text


def test_report_alone_counts_the_seeds_that_were_finished_and_writes_the_block_of_a_page(
    tmp_path, capsys
):
    for seed in (2, 0):
        folder = tmp_path / f"seed_{seed}"
        folder.mkdir()
        write_json(folder / "summary.json", {"seed": seed, "setups": make_setups(num_changed=seed)})
    (tmp_path / "seed_1").mkdir()  # interrupted
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- seeds: begin -->\nold\n<!-- seeds: end -->\n", encoding="utf-8")
    options = ["--out", str(tmp_path), "--report-only", "--page", str(page)]
    assert seeds_command.main(options) == 0
    assert "2 seeds of 20 runs" in page.read_text(encoding="utf-8")
    assert [line[:4] for line in (tmp_path / "seeds.md").read_text().splitlines()[-2:]] == [
        "| 0 ", "| 2 "
    ]  # fmt: skip
    assert main(["seeds", "--out", str(tmp_path / "empty"), "--report-only"]) == 1
    assert "no seed_*/summary.json" in capsys.readouterr().err
