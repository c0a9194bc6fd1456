"""Range and bearing: values, derivatives, wrapping, and the undefined bearing at the landmark."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from catoptra_client.landmarks import Detection
from catoptra_client.localization.ekf import (
    BearingOnly,
    RangeBearing,
    compute_innovation,
    is_finite,
    measurement_from_detection,
    predict_measurement,
)
from catoptra_client.localization.landmark_map import LandmarkPosition
from catoptra_protocol.errors import DomainError

R = np.diag([0.01, 0.001])


def make_landmark(x_m: float, y_m: float) -> LandmarkPosition:
    return LandmarkPosition("l", x_m, y_m)


def test_landmark_on_the_right_has_a_positive_bearing() -> None:
    expected, defined = predict_measurement(np.array([1.0, 1.0, 0.0]), make_landmark(1.0, 3.0))
    assert defined
    assert expected.range_m == 2.0
    assert expected.bearing_rad == pytest.approx(math.pi / 2)


def test_bearing_is_counted_from_the_heading_and_wrapped() -> None:
    expected, _ = predict_measurement(np.array([0.0, 0.0, -3.0]), make_landmark(-1.0, 0.1))
    exact = math.atan2(0.1, -1.0) + 3.0 - 2 * math.pi
    assert expected.bearing_rad == pytest.approx(exact, abs=1e-15)


@pytest.mark.parametrize("place", [(2.0, 0.5), (0.3, -1.7 + 1e-6), (-1e5, 3.0), (0.3, 4.0)])
def test_jacobian_equals_fifty_digit_differentiation(place: tuple[float, float]) -> None:
    pose = np.array([0.3, -1.7, 2.9])
    expected, _ = predict_measurement(pose, make_landmark(*place))
    with mp.workdps(60):
        for column in range(3):
            for row, function in enumerate((_exact_range, _exact_bearing)):
                exact = mpmath.diff(lambda v: function(pose, column, v, place), mpf(pose[column]))  # noqa: B023 # called at once
                assert expected.jacobian[row, column] == pytest.approx(float(exact), rel=4e-10)


def _position_difference(pose, column, value, place):
    values = [mpf(p) for p in pose]
    values[column] = value
    return mpf(place[0]) - values[0], mpf(place[1]) - values[1], values[2]


def _exact_range(pose, column, value, place):
    dx, dy, _ = _position_difference(pose, column, value, place)
    return mpmath.sqrt(dx * dx + dy * dy)


def _exact_bearing(pose, column, value, place):
    dx, dy, phi = _position_difference(pose, column, value, place)
    return mpmath.atan2(dy, dx) - phi


@pytest.mark.parametrize("scale", [1e-300, 1e-160, 1e-9, 1.0, 1e9, 1e150])
def test_expectation_stays_finite_at_extreme_ranges(scale: float) -> None:
    with np.errstate(all="raise"):
        expected, defined = predict_measurement(np.zeros(3), make_landmark(3 * scale, 4 * scale))
    assert defined
    assert expected.range_m == pytest.approx(5 * scale, rel=1e-15)
    assert np.isfinite(expected.jacobian).all()


def test_landmark_at_the_robot_is_undefined_not_nan() -> None:
    expected, defined = predict_measurement(np.array([1.0, 2.0, 0.0]), make_landmark(1.0, 2.0))
    assert not defined
    assert np.isfinite(expected.jacobian).all()


def test_residual_wraps_across_the_back() -> None:
    expected, _ = predict_measurement(np.zeros(3), make_landmark(-1.0, -0.01))
    innovation, _, _ = compute_innovation(RangeBearing(1.0, math.pi - 0.01, R), expected)
    assert innovation[1] == pytest.approx(-0.02, abs=1e-6)


def test_bearing_alone_keeps_one_row() -> None:
    expected, _ = predict_measurement(np.zeros(3), make_landmark(1.0, 1.0))
    innovation, jacobian, noise = compute_innovation(BearingOnly(1.0, 0.04), expected)
    assert (innovation.shape, jacobian.shape, noise.tolist()) == ((1,), (1, 3), [[0.04]])
    np.testing.assert_array_equal(jacobian[0], expected.jacobian[1])


@pytest.mark.parametrize(
    "measurement",
    [
        RangeBearing(math.nan, 0.0, R),
        RangeBearing(1.0, math.inf, R),
        RangeBearing(1.0, 0.0, R * math.nan),
        BearingOnly(math.nan, 0.1),
        BearingOnly(0.1, math.inf),
    ],
)
def test_measurement_with_a_number_not_finite_is_known(measurement) -> None:
    assert not is_finite(measurement)


@pytest.mark.parametrize(("has_range", "kind"), [(True, RangeBearing), (False, BearingOnly)])
def test_detection_becomes_range_and_bearing_or_bearing_alone(has_range: bool, kind: type) -> None:
    seen = Detection("l", "beacon", 2.0, 0.5, np.diag([0.04, 0.01]), 20, has_range)
    measurement = measurement_from_detection(seen)
    assert isinstance(measurement, kind)
    assert measurement.bearing_rad == 0.5


def test_covariance_of_another_shape_is_rejected() -> None:
    with pytest.raises(DomainError, match=r"\(2, 2\)"):
        RangeBearing(1.0, 0.0, np.eye(3))
