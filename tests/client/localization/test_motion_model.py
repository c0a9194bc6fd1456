"""From odometry to controls, and a pose by its control."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from catoptra_client.localization import Control, OdometryPose, control_from_odometry
from catoptra_client.localization.motion_model import (
    MotionNoise,
    chord_over_arc,
    chord_over_arc_derivative,
    control_covariance,
    jacobian_wrt_control,
    jacobian_wrt_pose,
    propagate_pose,
)
from catoptra_protocol.errors import DomainError

START = OdometryPose(0.4, -0.2, 2.5)


def propagate_odometry(control: Control) -> OdometryPose:
    return OdometryPose(
        *propagate_pose(np.array([START.x_m, START.y_m, START.yaw_rad]), control).tolist()
    )


@pytest.mark.parametrize("distance_m", [0.2, -0.2, 0.0, 3.0])
@pytest.mark.parametrize("turn_rad", [0.0, 1e-12, 0.3, -0.8, 2.0, 3.1, -3.1])
def test_control_is_recovered_from_the_poses_it_led_to(distance_m, turn_rad) -> None:
    control = control_from_odometry(START, propagate_odometry(Control(distance_m, turn_rad)))
    assert control.distance_m == pytest.approx(distance_m, abs=1e-14)
    assert control.turn_rad == pytest.approx(turn_rad, abs=1e-14)


def test_turn_across_the_wrap_is_short() -> None:
    control = control_from_odometry(OdometryPose(0, 0, 3.1), OdometryPose(0, 0, -3.1))
    assert control.turn_rad == pytest.approx(2 * math.pi - 6.2)


def test_standing_still_is_no_control() -> None:
    assert control_from_odometry(START, START) == Control(0.0, 0.0)


def test_slip_to_the_side_is_no_driving() -> None:
    control = control_from_odometry(OdometryPose(0, 0, 0), OdometryPose(0.2, 0.05, 0))
    assert control.distance_m == pytest.approx(0.2)


HALF_TURNS = [
    *(0.0, 5e-324, 1e-300, 1e-160, 1e-12, 1e-9, 1e-6, 1e-3, 0.05, 0.3, 0.999999, 1.0, 1.000001),
    *(1.5, math.pi / 2, 3.0, math.pi, 4.49, 10.0),
]
TURNS = [0.0, 1e-300, 1e-12, 1e-8, 1e-3, 0.1, 0.7, math.pi / 2, 1.999999, 2.0, 3.0, math.pi, -2.5]
POSE = np.array([0.3, -1.7, 2.9])


@pytest.fixture(autouse=True)
def _fifty_digits():
    with mp.workdps(50):
        yield


def exact_chord_over_arc_derivative(a: float) -> mpf:
    """S' with digits to spare for the cancellation of a^-2."""
    with mp.workdps(700):
        x = mpf(a)
        return (x * mpmath.cos(x) - mpmath.sin(x)) / x**2 if a else mpf(0)


def propagate_pose_exactly(x, y, phi, v, turn):
    """x', y', phi' by the circle through the start; the turn is not zero."""
    radius = v / turn
    return (
        x + radius * (mpmath.sin(phi + turn) - mpmath.sin(phi)),
        y - radius * (mpmath.cos(phi + turn) - mpmath.cos(phi)),
        phi + turn,
    )


@pytest.mark.parametrize("a", HALF_TURNS)
def test_chord_over_arc_holds_to_rounding(a: float) -> None:
    exact = mpmath.sin(mpf(a)) / mpf(a) if a else mpf(1)
    assert abs(chord_over_arc(a) - exact) <= 4e-16
    assert chord_over_arc(-a) == chord_over_arc(a)


@pytest.mark.parametrize("a", HALF_TURNS)
def test_slope_holds_relatively_to_1e_14(a: float) -> None:
    exact = exact_chord_over_arc_derivative(a)
    # Near its zero at 4.493 rad, and where it is subnormal, only the absolute error is bounded.
    floor = mpf("5e-17") if a > 4 else mpf("5e-324")
    assert abs(chord_over_arc_derivative(a) - exact) <= max(abs(exact) * mpf("1e-14"), floor)
    assert chord_over_arc_derivative(-a) == -chord_over_arc_derivative(a)


@pytest.mark.parametrize("turn", [turn for turn in TURNS if turn])
def test_moved_follows_the_exact_circle(turn: float) -> None:
    with mp.workdps(650):  # 1e-300 of a turn needs as many digits in the circle's form
        exact = propagate_pose_exactly(*map(mpf, POSE), mpf(0.2), mpf(turn))
    new = propagate_pose(POSE, Control(0.2, turn))
    assert abs(new[0] - exact[0]) < 1e-15
    assert abs(new[1] - exact[1]) < 1e-15
    assert abs(mpmath.sin((mpf(new[2]) - exact[2]) / 2)) < 1e-15


def test_moved_straight_on_is_a_straight_line() -> None:
    new = propagate_pose(np.array([1.0, 2.0, math.pi / 6]), Control(2.0, 0.0))
    np.testing.assert_allclose(new, [1 + math.sqrt(3), 3.0, math.pi / 6], rtol=0, atol=1e-15)


def test_heading_wraps_at_half_a_turn() -> None:
    new = propagate_pose(np.array([0.0, 0.0, 3.1]), Control(0.0, 0.1))
    assert new[2] == pytest.approx(3.2 - 2 * math.pi, abs=1e-15)


def exact_jacobian_entry(index: int, argument: int, turn: float) -> mpf:
    values = [*map(mpf, POSE), mpf(0.2), mpf(turn)]

    def evaluate(value):
        moved_values = [*values[:argument], value, *values[argument + 1 :]]
        return propagate_pose_exactly(*moved_values)[index]

    return mpmath.diff(evaluate, values[argument])


@pytest.mark.parametrize("turn", [1e-8, 1e-3, 0.1, 0.7, math.pi / 2, 2.0, 3.0, -2.5])
def test_jacobians_equal_fifty_digit_differentiation(turn: float) -> None:
    control = Control(0.2, turn)
    ours = np.hstack((jacobian_wrt_pose(POSE, control), jacobian_wrt_control(POSE, control)))
    with mp.workdps(80):
        exact = [[float(exact_jacobian_entry(i, j, turn)) for j in range(5)] for i in range(3)]
    np.testing.assert_allclose(ours, exact, rtol=0, atol=5e-16)


def test_jacobian_by_control_at_zero_turn_is_its_limit() -> None:
    phi, v = 0.4, 0.7
    ours = jacobian_wrt_control(np.array([0.0, 0.0, phi]), Control(v, 0.0))
    c, s = math.cos(phi), math.sin(phi)
    np.testing.assert_allclose(
        ours, [[c, -0.5 * v * s], [s, 0.5 * v * c], [0, 1]], rtol=0, atol=1e-16
    )


def test_noise_of_a_step_is_the_alphas_times_squares() -> None:
    noise = MotionNoise(0.01, 0.02, 0.03, 0.04)
    np.testing.assert_allclose(
        np.diagonal(control_covariance(Control(2.0, 3.0), noise)),
        [0.01 * 4 + 0.02 * 9, 0.03 * 4 + 0.04 * 9],
    )


def test_standing_still_has_no_noise() -> None:
    assert not control_covariance(Control(0.0, 0.0), MotionNoise(1.0, 1.0, 1.0, 1.0)).any()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_are_not_finite_are_rejected(bad: float) -> None:
    with pytest.raises(DomainError, match="finite"):
        Control(bad, 0.0)
    with pytest.raises(DomainError, match="alphas"):
        MotionNoise(0.0, bad, 0.0, 0.0)


def test_negative_alpha_is_rejected() -> None:
    with pytest.raises(DomainError, match="not negative"):
        MotionNoise(-1e-9, 0.0, 0.0, 0.0)
