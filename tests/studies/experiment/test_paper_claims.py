"""Claims are confirmed by the numbers alone."""

from __future__ import annotations

from copy import deepcopy

import pytest

from catoptra_studies.experiment.paper_claims import evaluate_claims


def value(number: float | None):
    return None if number is None else {"median": number, "mean": number, "count": 20}


GOOD = {
    "odometry_max_m": value(1.5),
    "odometry_steps_above_1m": value(12.0),
    "ekf_max_m": value(0.4),
    "accepted_steps_1_to_8": value(0.9),
    "accepted_steps_9_to_22": value(0.4),
    "accepted_steps_23_to_40": value(0.8),
    "relock_step": value(24.0),
    "ekf_worse_in_first_5_steps": value(0.9),
}


def setups(**changed):
    statistics = {**deepcopy(GOOD), **changed}
    return {
        name: {"filters": {"paper": {"statistics": statistics, "seeds": list(range(20))}}}
        for name in ("sim", "real")
    }


def test_all_claims_are_confirmed_by_the_papers_numbers():
    claims = evaluate_claims(setups())
    assert len(claims) == 8
    assert all(claim.is_confirmed for claim in claims)


@pytest.mark.parametrize(
    ("key", "number", "num_refuted"),
    [
        ("odometry_max_m", 0.9, 2),
        ("odometry_steps_above_1m", 1.0, 2),
        ("ekf_max_m", 0.61, 2),
        ("accepted_steps_9_to_22", 0.6, 1),
        ("relock_step", 40.0, 1),
        ("relock_step", None, 1),
        ("accepted_steps_1_to_8", 0.2, 1),
        ("ekf_worse_in_first_5_steps", 0.3, 1),
    ],
)
def test_claim_when_its_number_is_off_is_not_confirmed(key, number, num_refuted):
    claims = evaluate_claims(setups(**{key: value(number)}))
    assert sum(not claim.is_confirmed for claim in claims) == num_refuted
