"""One prediction, one correction: values, definiteness, and rejected measurements."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.localization import (
    OPEN_GATE,
    PAPER_GATE,
    BearingOnly,
    Belief,
    Control,
    LandmarkPosition,
    MotionNoise,
    RangeBearing,
    UpdateStatus,
    predict,
    update,
)
from catoptra_client.localization.ekf import predict_measurement

LANDMARK = LandmarkPosition("l", 2.0, 1.0)
R = np.diag([0.04, 0.002])
NOISE = MotionNoise(0.01, 0.001, 0.0005, 0.0064)


def make_belief(scale: float = 1.0) -> Belief:
    factor = np.array([[0.3, 0.0, 0.0], [0.1, 0.2, 0.0], [0.05, -0.1, 0.1]])
    return Belief(np.array([0.2, -0.1, 0.5]), scale * factor @ factor.T)


def make_measurement(belief: Belief, *, range_error_m: float = 0.0, bearing_error_rad: float = 0.0):
    expected, _ = predict_measurement(belief.mean, LANDMARK)
    bearing = expected.bearing_rad + bearing_error_rad
    return RangeBearing(expected.range_m + range_error_m, bearing, R)


def test_prediction_equals_the_textbook_sum() -> None:
    before, control = make_belief(), Control(0.2, 0.0)
    after = predict(before, control, noise=NOISE)
    c, s, v = math.cos(0.5), math.sin(0.5), 0.2
    G = np.array([[1, 0, -v * s], [0, 1, v * c], [0, 0, 1]])
    V = np.array([[c, -v * s / 2], [s, v * c / 2], [0, 1]])
    M = np.diag([0.01 * v**2, 0.0005 * v**2])
    expected = G @ before.covariance @ G.T + V @ M @ V.T
    np.testing.assert_allclose(after.covariance, expected, rtol=1e-14, atol=1e-18)


def test_prediction_from_zero_covariance_has_rank_two() -> None:
    after = predict(Belief(np.zeros(3), np.zeros((3, 3))), Control(0.2, 0.1), noise=NOISE)
    assert np.linalg.matrix_rank(after.covariance) == 2


def test_time_standing_still_changes_nothing() -> None:
    before = make_belief()
    after = predict(before, Control(0.0, 0.0), noise=NOISE)
    np.testing.assert_array_equal(after.mean, before.mean)
    np.testing.assert_allclose(after.covariance, before.covariance, rtol=1e-14)


def test_correction_equals_the_information_form() -> None:
    before = make_belief()
    after = update(before, make_measurement(before), landmark=LANDMARK, gate=PAPER_GATE)
    H = predict_measurement(before.mean, LANDMARK)[0].jacobian
    information = np.linalg.inv(before.covariance) + H.T @ np.linalg.inv(R) @ H
    assert after.is_accepted
    np.testing.assert_allclose(after.belief.covariance, np.linalg.inv(information), rtol=1e-11)
    np.testing.assert_allclose(after.belief.mean, before.mean, rtol=0, atol=1e-15)


def test_correction_moves_towards_the_measurement() -> None:
    before = make_belief()
    measured = make_measurement(before, range_error_m=-0.2)
    after = update(before, measured, landmark=LANDMARK, gate=PAPER_GATE)
    assert 0.0 < after.nis < 9.21034
    new_range = predict_measurement(after.belief.mean, LANDMARK)[0].range_m
    assert measured.range_m < new_range < measured.range_m + 0.2


def test_bearing_alone_narrows_the_heading() -> None:
    before = make_belief()
    measured = BearingOnly(make_measurement(before).bearing_rad + 0.02, 0.001)
    after = update(before, measured, landmark=LANDMARK, gate=PAPER_GATE)
    assert after.is_accepted
    assert after.innovation.shape == (1,)
    assert after.belief.covariance[2, 2] < before.covariance[2, 2]


def test_innovation_across_the_back_is_small() -> None:
    belief = Belief(np.zeros(3), 0.01 * np.eye(3))
    behind = LandmarkPosition("behind", -2.0, -1e-3)
    measured = RangeBearing(2.0, math.pi - 1e-3, R)
    result = update(belief, measured, landmark=behind, gate=PAPER_GATE)
    assert result.is_accepted
    assert abs(result.innovation[1]) < 2e-3


def test_measurement_outside_the_gate_leaves_the_belief_itself() -> None:
    before = make_belief()
    result = update(
        before, make_measurement(before, range_error_m=3.0), landmark=LANDMARK, gate=PAPER_GATE
    )
    assert result.status is UpdateStatus.OUTSIDE_GATE
    assert result.belief is before
    assert result.nis > 9.21034
    assert result.innovation_covariance.shape == (2, 2)


def test_open_gate_accepts_an_innovation_that_the_gate_rejects() -> None:
    before = make_belief()
    far = make_measurement(before, range_error_m=3.0)
    assert update(before, far, landmark=LANDMARK, gate=OPEN_GATE).is_accepted


UNUSABLE_MEASUREMENTS = [
    (RangeBearing(math.nan, 0.0, R), LANDMARK, UpdateStatus.NOT_FINITE),
    (RangeBearing(1.0, -math.inf, R), LANDMARK, UpdateStatus.NOT_FINITE),
    (BearingOnly(0.0, math.nan), LANDMARK, UpdateStatus.NOT_FINITE),
    (RangeBearing(1.0, 0.0, -R), LANDMARK, UpdateStatus.INVALID_NOISE_COVARIANCE),
    (BearingOnly(0.0, -0.1), LANDMARK, UpdateStatus.INVALID_NOISE_COVARIANCE),
    (RangeBearing(1.0, 0.0, R), LandmarkPosition("here", 0.2, -0.1), UpdateStatus.AT_LANDMARK),
    (RangeBearing(1.0, 0.0, R), LandmarkPosition("near", 0.2, -0.06), UpdateStatus.AT_LANDMARK),
    (RangeBearing(1.0, 0.0, R * 1e308 * 40), LANDMARK, UpdateStatus.OVERFLOW),
]


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")  # the last case is made so
@pytest.mark.parametrize(("measurement", "landmark", "reason"), UNUSABLE_MEASUREMENTS[:-1])
def test_unusable_measurement_is_rejected_with_a_status(measurement, landmark, reason) -> None:
    before = make_belief()
    result = update(before, measurement, landmark=landmark, gate=PAPER_GATE)
    assert result.status is reason
    assert not result.has_innovation
    assert result.belief is before


def test_two_certainties_are_rejected_as_singular() -> None:
    certain = Belief(np.zeros(3), np.zeros((3, 3)))
    measured = RangeBearing(2.2, 0.4, np.zeros((2, 2)))
    result = update(certain, measured, landmark=LANDMARK, gate=OPEN_GATE)
    assert result.status is UpdateStatus.SINGULAR


def test_rank_one_belief_and_exact_sensor_are_rejected_as_singular() -> None:
    direction = np.array([0.3, 0.2, 0.1])
    belief = Belief(np.zeros(3), np.outer(direction, direction))
    measured = RangeBearing(2.2, 0.4, np.zeros((2, 2)))
    result = update(belief, measured, landmark=LANDMARK, gate=OPEN_GATE)
    assert result.status is UpdateStatus.SINGULAR


@pytest.mark.parametrize("scale", [1e-300, 1e-30, 1e-10, 1.0, 1e10, 1e30, 1e150])
@pytest.mark.parametrize("noise", [1e-300, 1e-30, 1e-10, 1.0, 1e10, 1e150])
def test_extreme_scales_give_a_covariance_or_a_reason(scale: float, noise: float) -> None:
    belief = make_belief(scale)
    measured = RangeBearing(2.2, 0.1, R * noise)
    result = update(belief, measured, landmark=LANDMARK, gate=OPEN_GATE)
    assert np.isfinite(result.belief.mean).all()
    assert np.isfinite(result.belief.covariance).all()


def test_covariance_stays_definite_over_many_exact_updates() -> None:
    belief, tiny = make_belief(), np.diag([1e-10, 1e-10])
    for step in range(3000):
        landmark = LandmarkPosition("l", 2.0 * math.cos(step), 2.0 * math.sin(step))
        expected, _ = predict_measurement(belief.mean, landmark)
        measured = RangeBearing(expected.range_m, expected.bearing_rad, tiny)
        belief = update(belief, measured, landmark=landmark, gate=PAPER_GATE).belief
        belief = predict(belief, Control(0.01, 0.01), noise=NOISE) if step % 7 == 0 else belief
    np.testing.assert_array_equal(belief.covariance, belief.covariance.T)
    assert np.linalg.eigvalsh(belief.covariance)[0] > 0.0


def test_driving_to_and_fro_without_noise_keeps_a_low_rank_definite() -> None:
    direction = np.array([0.0, 0.1, 0.2])
    belief = Belief(np.zeros(3), np.outer(direction, direction))
    quiet = MotionNoise(0.0, 0.0, 0.0, 0.0)
    for step in range(400):
        belief = predict(belief, Control(0.5 * (-1) ** step, 0.0), noise=quiet)
    assert belief.covariance[1, 1] == pytest.approx(0.01, rel=1e-10)
