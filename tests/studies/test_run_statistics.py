"""Shares, medians and differences over runs, against published tables and exact counts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_studies.run_statistics import (
    RunShare,
    compare_pairs,
    median_with_interval,
    pool_shares,
)


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


def test_interval_of_all_runs_mirrors_that_of_none_and_of_no_runs_is_the_whole():
    low, high = RunShare(20, 20).interval
    assert (1.0 - high, 1.0 - low) == pytest.approx(RunShare(0, 20).interval, abs=1e-15)
    assert high == 1.0
    assert math.isnan(RunShare(0, 0).share)
    assert RunShare(0, 0).interval == (0.0, 1.0)


def test_shares_are_pooled_and_printed():
    assert pool_shares([RunShare(2, 3), RunShare(4, 5)]) == RunShare(6, 8)
    assert str(RunShare(15, 20)) == "15 of 20 runs (53% to 89%)"


# Conover 1999, Table A3, and the binomial distribution: ranks 6 and 15 of 20, 1 and 6 of 6. Numbers
# of ways are beyond 64 bits from 64 runs on, beyond float64 from 1024 on.
@pytest.mark.parametrize(
    ("num_runs", "ranks"),
    [(6, (1, 6)), (9, (2, 8)), (20, (6, 15)), (64, (24, 41)), (1100, (518, 583))],
)
def test_median_has_the_interval_of_its_order_statistics(num_runs, ranks):
    values = np.random.default_rng(1).permutation(np.arange(1.0, num_runs + 1.0))
    assert median_with_interval(values) == (0.5 * (num_runs + 1.0), *ranks)


def test_median_of_five_runs_has_no_interval_of_95_percent():
    assert median_with_interval(np.arange(5.0)) == pytest.approx(
        (2.0, math.nan, math.nan), nan_ok=True
    )


def test_interval_of_the_median_covers_in_at_least_95_percent():
    draws = np.random.default_rng(2).lognormal(size=(2000, 20))
    ends = np.array([median_with_interval(row)[1:] for row in draws])
    covered = ((ends[:, 0] <= 1.0) & (ends[:, 1] >= 1.0)).mean()
    # 95.9 % by the binomial distribution; 2000 draws have a standard error of 0.4 %.
    assert 0.945 < covered < 0.973


def test_pairs_differ_by_the_sign_test_with_holms_steps():
    runs = np.arange(20.0)
    close = runs + np.where(runs < 12, -1.0, 1.0)
    first, second, third = compare_pairs({"a": runs, "b": runs + 1.0, "c": close})
    # 20 of 20 runs: 2 / 2^20, times three tests.
    assert (first.lower, first.higher) == ("a", "b")
    assert first.p_value == pytest.approx(3 * 2 / 2**20)
    assert str(first.runs) == "20 of 20 runs (84% to 100%)"
    # b equals c in eight runs, and c is smaller in the other twelve.
    assert (second.lower, second.higher, second.runs) == ("c", "b", RunShare(12, 12))
    assert second.p_value == pytest.approx(2 * 2 / 2**12)
    # 12 of 20, which were once called a confirmation: p is 0.50.
    assert third.p_value == pytest.approx(0.5034, abs=1e-4)
    assert [pair.is_decided for pair in (first, second, third)] == [True, True, False]


def test_pairs_of_many_runs_have_a_level():
    (pair,) = compare_pairs({"a": np.zeros(1100), "b": np.ones(1100)})
    assert 0.0 <= pair.p_value < 1e-300


def test_pairs_of_equal_values_do_not_differ():
    (pair,) = compare_pairs({"a": np.ones(20), "b": np.ones(20)})
    assert pair.p_value == 1.0
