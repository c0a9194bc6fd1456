"""Angles, half-angle tangents, units, and checks of domains."""

from __future__ import annotations

import math
from functools import partial

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import (
    TWO_PI,
    angle_difference,
    half_angle_tangent,
    interpolate_angle,
    require_domain,
    wrap_angle,
)
from catoptra_protocol.optics.units import metres_from_uu, radians_from_uu


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


@pytest.mark.parametrize(
    "place",
    [
        (1e-300, 0.0, 1.0),
        (1e-9, 1e-9, 1.0),
        (1.0, 0.0, 0.0),
        (1.0, 0.0, -0.0),
        (1.0, 0.0, 1e-17),
        (1.0, 0.0, -1e-17),
        (0.3, -0.4, -0.2),
        (1e-8, 0.0, -1.0),
        (1e-300, 0.0, -1.0),
    ],
)
def test_half_angle_in_a_hard_case_is_that_of_50_digits(
    place: tuple[float, float, float],
) -> None:
    with mpmath.workdps(50):
        x, y, z = map(mpmath.mpf, place)
        norm, rho = mpmath.sqrt(x * x + y * y + z * z), mpmath.hypot(x, y)
        # At the antipode 50 digits cancel too: the other form there.
        exact = float(rho / (norm + z) if z >= 0 else (norm - z) / rho)
    t, valid = half_angle_tangent(np.array(place))
    assert valid
    assert t == pytest.approx(exact, rel=1e-15)


def test_length_of_250_uu_is_a_metre() -> None:
    assert metres_from_uu(250.0) == 1.0


@pytest.mark.parametrize(
    ("angle_uu", "angle_rad"),
    [(16384.0, 0.5 * math.pi), (32768.0, math.pi), (-49152.0, -1.5 * math.pi), (0.0, 0.0)],
)
def test_angle_of_quarter_turns_is_exact(angle_uu: float, angle_rad: float) -> None:
    assert radians_from_uu(angle_uu) == pytest.approx(angle_rad, rel=1e-15)


def test_require_when_all_is_inside_raises_nothing() -> None:
    require_domain(np.ones((2, 3), dtype=bool), np.zeros((2, 3)), "anything")
    require_domain(True, 1.0, "anything")


def test_require_when_an_element_is_outside_names_it_and_carries_the_mask() -> None:
    values = np.array([[1.0, 2.0], [-3.0, -4.0]])
    with pytest.raises(
        DomainError, match=r"-3\.0 \(element 1, 0\) is outside .*: above 0"
    ) as raised:
        require_domain(values > 0.0, values, "above 0")
    assert raised.value.valid_mask.tolist() == [[True, True], [False, False]]


def test_require_when_a_vector_is_outside_names_the_vector() -> None:
    with pytest.raises(DomainError, match=r"\[1\.0, 2\.0\] \(element 1\)"):
        require_domain(np.array([True, False]), np.array([[0.0, 0.0], [1.0, 2.0]]), "zero")


def test_require_when_a_single_number_is_outside_names_no_element() -> None:
    with pytest.raises(DomainError, match=r"^nan is outside"):
        require_domain(False, np.nan, "a number")
