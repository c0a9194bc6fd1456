"""Shares of runs and their Wilson intervals, against published values."""

from __future__ import annotations

import math

import pytest

from catoptra_studies.experiment.paper_claims import RunShare, count_runs, pool_shares


# Newcombe 1998, Table I: method 3, the score interval without continuity correction.
@pytest.mark.parametrize(
    ("satisfying", "runs", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_interval_is_that_of_newcombes_table(satisfying, runs, low, high):
    assert RunShare(satisfying, runs).interval == pytest.approx((low, high), abs=5e-5)


def test_interval_of_all_runs_mirrors_that_of_none():
    low, high = RunShare(20, 20).interval
    assert (1.0 - high, 1.0 - low) == pytest.approx(RunShare(0, 20).interval, abs=1e-15)
    assert high == 1.0


def test_share_of_no_runs_confirms_nothing():
    assert math.isnan(RunShare(0, 0).share)
    assert RunShare(0, 0).interval == (0.0, 1.0)


def test_runs_are_counted_and_pooled():
    assert count_runs([True, False, True]) == RunShare(2, 3)
    assert pool_shares([RunShare(2, 3), RunShare(4, 5)]) == RunShare(6, 8)
    assert str(RunShare(15, 20)) == "15 of 20 runs (53% to 89%)"
