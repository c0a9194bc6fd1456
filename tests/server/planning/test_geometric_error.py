from __future__ import annotations

from catoptra_server.frames.plan.facet_error import GeometricError, apply_floor, sum_errors

FIRST = GeometricError(3.0, 0.3, 1.0, 0.05)
SECOND = GeometricError(1.0, 0.4, 2.0, 0.12)


def test_sum_adds_the_largest_and_squares_the_rms() -> None:
    assert sum_errors((FIRST, SECOND)) == GeometricError(4.0, 0.5, 3.0, 0.13)


def test_sum_of_nothing_is_no_error() -> None:
    assert sum_errors(()) == GeometricError(0.0, 0.0, 0.0, 0.0)


def test_floor_raises_smaller_maxima_and_keeps_the_rms() -> None:
    assert apply_floor(FIRST, SECOND) == GeometricError(3.0, 0.3, 2.0, 0.05)
