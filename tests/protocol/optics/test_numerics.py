"""Wrapped angles: the interval's ends, congruence, and nothing lost far out."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.numerics import TWO_PI, wrap_angle


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


@pytest.mark.parametrize("angle", [math.inf, -math.inf])
def test_angle_when_infinite_is_refused(angle: float) -> None:
    with pytest.raises(ValueError, match="domain"):
        wrap_angle(angle)
