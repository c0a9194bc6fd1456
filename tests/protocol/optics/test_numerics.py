"""Angles: ends of the interval, congruence, full precision after many turns."""

from __future__ import annotations

import math
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import (
    TWO_PI,
    angle_difference,
    interpolate_angle,
    wrap_angle,
)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (TWO_PI, 0.0),
        (-TWO_PI, 0.0),
        (1.5 * TWO_PI, math.pi),
        (-1.5 * TWO_PI, math.pi),
        (math.nextafter(-math.pi, 0.0), math.nextafter(-math.pi, 0.0)),
        (math.nextafter(-math.pi, -4.0), TWO_PI + math.nextafter(-math.pi, -4.0)),
        (1e-300, 1e-300),
        (0.25 + 1e6 * TWO_PI, 0.25),
    ],
)
def test_angle_when_wrapped_is_the_one_in_the_interval(angle: float, wrapped: float) -> None:
    # A million turns of the double nearest to 2 pi are known to 1e-9 rad.
    assert wrap_angle(angle) == pytest.approx(wrapped, abs=1e-9 if abs(angle) > 1e3 else 0.0)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.floats(-1e9, 1e9))
def test_angle_when_wrapped_is_congruent_and_inside(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.remainder(wrapped - angle, TWO_PI) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("angle", [math.inf, -math.inf, math.nan])
def test_angle_when_not_finite_is_rejected(angle: float) -> None:
    for wrong in (
        wrap_angle,
        partial(angle_difference, 0.0),
        partial(interpolate_angle, 0.0, fraction=1),
    ):
        with pytest.raises(DomainError, match="finite"):
            wrong(angle)


def test_difference_across_the_seam_is_short() -> None:
    assert angle_difference(-3.1, 3.1) == pytest.approx(TWO_PI - 6.2, abs=1e-15)
    assert angle_difference(-math.pi, math.pi) == 0.0


def test_difference_of_opposite_angles_is_half_a_turn_to_the_right() -> None:
    assert angle_difference(0.5 * math.pi, -0.5 * math.pi) == math.pi
    assert angle_difference(-0.5 * math.pi, 0.5 * math.pi) == math.pi


@pytest.mark.parametrize(("share", "angle"), [(0.0, 3.0), (0.5, math.pi), (1.0, TWO_PI - math.pi)])
def test_interpolation_takes_the_shorter_turn(share: float, angle: float) -> None:
    end = 2.0 * math.pi - 3.0 if share < 1.0 else math.pi
    assert interpolate_angle(3.0, end, fraction=share) == pytest.approx(angle, abs=1e-15)
