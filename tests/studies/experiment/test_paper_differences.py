"""Differences have the numbers of the runs, and their statements count what they say."""

from __future__ import annotations

import pytest

from catoptra_studies.experiment.paper_claims import (
    UNTYPICAL_STATEMENTS,
    evaluate_statements,
    list_differences,
)
from studies.experiment.test_paper_claims import make_setups

STATISTICS = {
    "ekf_max_steps_61_to_84_m": {"median": 0.03, "p05": 0.02, "p95": 0.05},
    "ekf_mean_on_diagonal_m": {"median": 0.0349, "p05": 0.02, "p95": 0.05},
}
MEASUREMENTS = {"range_error_m": {"rms": 0.013}, "bearing_error_deg": {"rms": 0.05}}


def make_summary(**changes):
    setups = make_setups(**changes)
    for setup in setups.values():
        setup["filters"]["paper"]["statistics"] = STATISTICS
        setup["measurements"] = MEASUREMENTS
    return setups


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"accepted_steps_9_to_22": 0.49}, "real_most_rejected"),
        ({"relock_step": 24}, "real_all_rejected"),
        ({"ekf_max_steps_61_to_84_m": 0.31}, "real_second_growth"),
    ],
)
def test_untypical_statement_counts_the_runs_that_satisfy_it(changed, key):
    setups = make_summary(num_changed=3, **changed)
    counts = {
        claim.key: claim.runs.num_satisfying
        for claim in evaluate_statements(UNTYPICAL_STATEMENTS, setups)
    }
    # The runs that are not changed reach 0.25 m in step 84.
    assert counts.pop(key) == 3
    assert set(counts.values()) == {0}


def test_differences_have_the_numbers_of_both():
    lock_out, growth, diagonal, accuracy = list_differences(make_summary())
    assert "step 23" in lock_out.paper
    assert "0 of 20 runs" in lock_out.here
    assert "0.03 m at most" in growth.here
    assert "0.349 m" in diagonal.paper
    assert "10 times less" in diagonal.here
    assert "13 mm and 0.05°" in accuracy.here


def test_lock_out_names_the_steps_in_which_landmarks_pass_again():
    lock_out, *_ = list_differences(make_summary(num_changed=2, relock_step=25))
    assert "step 25 to 25" in lock_out.here


def test_differences_of_one_setup_need_no_other():
    setups = make_summary()
    assert len(list_differences({"sim": setups["sim"]})) == 1
    assert len(list_differences({"real": setups["real"]})) == 2


def test_accuracy_without_measurements_is_said():
    setups = make_summary()
    setups["sim"]["measurements"] = {"range_error_m": {}, "bearing_error_deg": {}}
    assert "none was measured" in list_differences(setups)[-1].here
