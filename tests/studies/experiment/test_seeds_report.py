"""The report of many seeds: pooled shares, the worst seed, and each seed's status."""

from __future__ import annotations

from catoptra_studies.experiment.paper_claims import Claim, RunShare
from catoptra_studies.experiment.seeds_command import SeedResult, format_seeds_report


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
