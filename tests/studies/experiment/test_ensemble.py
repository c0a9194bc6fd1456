"""Figures over many runs: quantiles of what is there, and the run to show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_studies.experiment.ensemble import (
    compute_run_metrics,
    error_quantiles,
    median_run_index,
    summarise_runs,
    summary_statistics,
)
from catoptra_studies.experiment.filter_replay import FilterRun

STEPS = 101


def trace(seed: int, *, largest_m: float) -> FilterRun:
    """Return a trace whose filter error rises to a maximum, and whose odometry is twice as bad."""
    error = np.linspace(0.0, largest_m, STEPS)
    ones = np.ones(STEPS, dtype=np.int64)
    poses = np.zeros((STEPS, 3))
    return FilterRun(
        "paper", seed, poses, poses, error, 2.0 * error, ones, ones, 0 * ones, 0.5 * error
    )


def test_spread_ignores_what_is_missing():
    found = summary_statistics([1.0, None, 3.0])
    assert found is not None
    assert (found.median, found.mean, found.count) == (2.0, 2.0, 2)
    assert summary_statistics([None, None]) is None


def test_run_figures_count_the_steps_above_a_metre():
    figures = compute_run_metrics(trace(0, largest_m=1.0))
    assert figures.odometry_max_m == 2.0
    assert figures.odometry_steps_above_1m == 50  # 2 k / 100 > 1 from k = 51 on
    assert figures.ekf_max_m == 1.0
    assert figures.windowed_nis_max == 0.5
    assert figures.accepted_steps_9_to_22 == 1.0
    assert figures.relock_step is None
    assert not figures.ekf_worse_in_first_5_steps


def test_share_of_steps_without_landmarks_is_missing():
    blind = replace(trace(0, largest_m=1.0), num_measured=np.zeros(STEPS, dtype=np.int64))
    assert compute_run_metrics(blind).accepted_steps_1_to_8 is None


def test_typical_run_has_the_median_largest_error():
    traces = [trace(seed, largest_m=m) for seed, m in enumerate([0.9, 0.1, 0.5])]
    assert traces[median_run_index(traces)].seed == 2


def test_summary_holds_every_run_and_its_spread():
    found = summarise_runs([trace(seed, largest_m=0.1 * (seed + 1)) for seed in range(3)])
    assert found["seeds"] == [0, 1, 2]
    assert found["spread"]["ekf_max_m"]["median"] == pytest.approx(0.2)


def test_error_bands_enclose_the_median():
    traces = [trace(seed, largest_m=0.1 * seed) for seed in range(11)]
    low, median, high = error_quantiles(traces, of_odometry=False)
    assert (low <= median).all()
    assert (median <= high).all()
    assert median[-1] == pytest.approx(0.5)
