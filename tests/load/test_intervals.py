"""Intervals and rates of arrivals within a phase."""

from __future__ import annotations

import pytest

from load.intervals import Phase, late_fraction


def test_intervals_when_arrivals_stop_include_the_open_one() -> None:
    intervals_s = Phase(10.0, 14.0).intervals_s([9.8, 10.1, 10.3])
    assert intervals_s == pytest.approx([0.3, 0.2, 3.7])


def test_intervals_without_arrivals_are_the_whole_phase() -> None:
    assert Phase(10.0, 14.0).intervals_s([]) == [4.0]


def test_intervals_when_nothing_arrives_in_the_phase_begin_with_the_last_arrival_before() -> None:
    assert Phase(10.0, 14.0).intervals_s([7.0, 20.0]) == [7.0]


def test_rate_counts_arrivals_in_the_phase_alone() -> None:
    assert Phase(10.0, 12.0).rate([9.0, 10.5, 11.0, 11.5, 13.0]) == 1.5


def test_late_fraction_counts_longer_intervals() -> None:
    assert late_fraction([0.2, 0.25, 0.3, 0.2], 0.24) == 0.5
