"""Each claim holds for runs like the paper's, and fails where its own metric is changed."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import pytest

from catoptra_studies.experiment.metrics import compute_run_metrics
from catoptra_studies.experiment.paper_claims import STATEMENTS, evaluate_claims
from studies.experiment.test_ensemble import make_filter_run

# A run of the paper's filter as the paper describes it.
PAPER_RUN = {
    "odometry_steps_above_1m": 12,
    "ekf_max_m": 0.4,
    "ekf_mean_steps_9_to_23_m": 0.3,
    "ekf_mean_steps_31_to_60_m": 0.1,
    "accepts_first_measurements": True,
    "accepted_steps_1_to_22": 0.5,
    "ekf_worse_in_first_5_steps": True,
}
CONSISTENT_RUN = {"accepted_steps_1_to_22": 0.9}


def make_run(run: int, changes: dict[str, Any]) -> dict[str, Any]:
    return asdict(compute_run_metrics(make_filter_run(run, largest_m=0.3))) | changes


def make_setups(*, num_changed: int = 0, num_runs: int = 20, **changed: Any) -> dict[str, Any]:
    """Summary of both set-ups in which the first runs differ from the paper's."""
    paper = [
        make_run(run, PAPER_RUN | (changed if run < num_changed else {})) for run in range(num_runs)
    ]
    consistent = [make_run(run, CONSISTENT_RUN) for run in range(num_runs)]
    filters = {"paper": {"runs": paper}, "consistent": {"runs": consistent}}
    return {"sim": {"filters": filters}, "real": {"filters": filters}}


def unconfirmed(setups: dict[str, Any]) -> set[str]:
    return {claim.key for claim in evaluate_claims(setups) if not claim.is_confirmed}


def test_all_claims_are_confirmed_by_runs_like_the_papers():
    claims = evaluate_claims(make_setups())
    assert [claim.key for claim in claims] == [statement.key for statement in STATEMENTS]
    assert all(claim.runs.num_satisfying == 20 for claim in claims)
    assert not unconfirmed(make_setups())


CHANGES = [
    ({"odometry_steps_above_1m": 2}, {"sim_odometry", "real_odometry"}),
    ({"ekf_max_m": 0.6}, {"sim_bound", "real_bound", "sim_whole_run"}),
    ({"ekf_max_m": 0.5}, {"sim_whole_run"}),
    ({"accepted_steps_1_to_22": 0.9}, {"real_gate"}),
    ({"accepted_steps_1_to_22": None}, {"real_gate"}),
    ({"ekf_mean_steps_31_to_60_m": 0.15}, {"real_recovery"}),
    ({"accepts_first_measurements": False}, {"sim_gate"}),
    ({"accepts_first_measurements": None}, {"sim_gate"}),
    ({"ekf_worse_in_first_5_steps": False}, {"sim_start"}),
]


@pytest.mark.parametrize(("changed", "keys"), CHANGES)
def test_claim_when_half_of_the_runs_differ_is_not_confirmed(changed, keys):
    assert unconfirmed(make_setups(num_changed=10, **changed)) == keys


@pytest.mark.parametrize(("changed", "keys"), CHANGES)
def test_claim_when_fewer_than_half_of_the_runs_differ_is_confirmed(changed, keys):
    setups = make_setups(num_changed=9, **changed)
    assert not unconfirmed(setups)
    assert {c.key for c in evaluate_claims(setups) if c.runs.num_satisfying == 11} == keys


def test_every_statement_is_changed_by_a_case_above():
    assert set().union(*(keys for _, keys in CHANGES)) == {s.key for s in STATEMENTS}


def test_claims_about_a_setup_that_was_not_driven_are_left_out():
    claims = evaluate_claims({"sim": make_setups()["sim"]})
    assert claims
    assert all(claim.text.startswith("sim: ") for claim in claims)
