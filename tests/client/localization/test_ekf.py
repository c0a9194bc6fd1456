"""The filter and its parts: belief, measurement, gate, prediction and update."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.landmarks import Detection
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
from catoptra_client.localization.ekf import (
    compute_innovation,
    covariance_square_root,
    measurement_from_detection,
    predict_measurement,
)
from catoptra_protocol.errors import DomainError

ZERO = np.zeros((3, 3))


def is_covariance(matrix: np.ndarray) -> bool:
    return covariance_square_root(matrix)[1]


def test_belief_copies_freezes_and_wraps() -> None:
    mean = np.array([0.0, 0.0, 4.0])
    belief = Belief(mean, ZERO)
    mean[0] = 9.0
    assert belief.mean[0] == 0.0
    assert belief.mean[2] == pytest.approx(4.0 - 2 * math.pi)
    with pytest.raises(ValueError, match="read-only"):
        belief.covariance[0, 0] = 1.0


@pytest.mark.parametrize(
    ("mean", "covariance", "message"),
    [
        (np.zeros(2), ZERO, "not"),
        (np.zeros(3), np.zeros((2, 2)), "not"),
        (np.array([0.0, math.nan, 0.0]), ZERO, "finite"),
        (np.zeros(3), ZERO + math.inf, "finite"),
        (np.zeros(3), np.diag([1.0, -1e-6, 1.0]), "negative"),
        (np.zeros(3), np.array([[1, 2, 0], [2, 1, 0], [0, 0, 1.0]]), "negative"),
        (np.zeros(3), np.array([[0, 1, 0], [1, 1, 0], [0, 0, 1.0]]), "negative"),
    ],
)
def test_belief_rejects_an_invalid_covariance(mean, covariance, message) -> None:
    with pytest.raises(DomainError, match=message):
        Belief(mean, covariance)


@pytest.mark.parametrize("scale", [0.0, 1e-300, 1e-20, 1.0, 1e20, 1e300])
def test_definiteness_does_not_depend_on_scale(scale: float) -> None:
    good = np.array([[2, 1, 0], [1, 2, 1], [0, 1, 2.0]]) * scale
    assert is_covariance(good)
    if scale:
        assert not is_covariance(good - np.diag([0, 1.5, 0]) * scale)


def test_metres_do_not_hide_radians() -> None:
    covariance = np.diag([1e6, 1e6, 1e-12])
    covariance[2, 0] = covariance[0, 2] = 1.1e-3  # a correlation of 1.1
    assert not is_covariance(covariance)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_square_root_squares_to_the_covariance_at_any_rank(rank: int) -> None:
    factor = np.random.default_rng(rank).normal(size=(3, rank)) * np.array([[10], [1], [1e-4]])
    covariance = factor @ factor.T
    root, valid = covariance_square_root(covariance)
    assert valid
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("rank", [1, 2])
@pytest.mark.parametrize(("lowest", "valid"), [(-1e-13, True), (-1e-11, False), (-1e-6, False)])
def test_verdict_is_that_of_the_lowest_eigenvalue(rank: int, lowest: float, valid: bool) -> None:
    for seed in range(50):
        rows = np.random.default_rng(seed).normal(size=(3, rank))
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        assert is_covariance(rows @ rows.T + lowest * np.eye(3)) is valid


@pytest.mark.parametrize("apart", [0.0, 1e-16, 1e-12, 1e-8, 1.0])
@pytest.mark.parametrize("scale", [1e-290, 1e-9, 1.0, 1e290])
def test_square_root_is_exact_at_equal_eigenvalues(apart: float, scale: float) -> None:
    for seed in range(50):
        turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
        covariance = scale * (turn * (1.0, 1.0 + apart, 0.5)) @ turn.T
        covariance = 0.5 * covariance + 0.5 * covariance.T
        root, valid = covariance_square_root(covariance)
        assert valid
        np.testing.assert_allclose(root @ root.T, covariance, rtol=0, atol=2e-15 * scale)


def test_variance_below_the_normal_floats_counts_as_zero() -> None:
    root, valid = covariance_square_root(np.array([[5e-324, 0.0], [0.0, 4.0]]))
    assert valid
    np.testing.assert_array_equal(root, [[0.0, 0.0], [0.0, 2.0]])


def test_belief_keeps_a_read_only_square_root_of_its_covariance() -> None:
    covariance = np.array([[0.09, 0.03, 0.0], [0.03, 0.05, -0.002], [0.0, -0.002, 0.001]])
    belief = Belief(np.zeros(3), covariance)
    root = belief.square_root
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-13, atol=1e-16)
    with pytest.raises(ValueError, match="read-only"):
        root[0, 0] = 1.0


R = np.diag([0.01, 0.001])


def make_landmark(x_m: float, y_m: float) -> LandmarkPosition:
    return LandmarkPosition("l", x_m, y_m)


def test_landmark_on_the_right_has_a_positive_bearing() -> None:
    expected, defined = predict_measurement(np.array([1.0, 1.0, 0.0]), make_landmark(1.0, 3.0))
    assert defined
    assert expected.range_m == 2.0
    assert expected.bearing_rad == pytest.approx(math.pi / 2)


def test_landmark_at_the_robot_is_undefined_not_nan() -> None:
    expected, defined = predict_measurement(np.array([1.0, 2.0, 0.0]), make_landmark(1.0, 2.0))
    assert not defined
    assert np.isfinite(expected.jacobian).all()


def test_bearing_alone_keeps_one_row() -> None:
    expected, _ = predict_measurement(np.zeros(3), make_landmark(1.0, 1.0))
    innovation, jacobian, noise = compute_innovation(BearingOnly(1.0, 0.04), expected)
    assert (innovation.shape, jacobian.shape, noise.tolist()) == ((1,), (1, 3), [[0.04]])
    np.testing.assert_array_equal(jacobian[0], expected.jacobian[1])


@pytest.mark.parametrize(("has_range", "kind"), [(True, RangeBearing), (False, BearingOnly)])
def test_detection_becomes_range_and_bearing_or_bearing_alone(has_range: bool, kind: type) -> None:
    seen = Detection("l", "beacon", 2.0, 0.5, np.diag([0.04, 0.01]), 20, has_range)
    measurement = measurement_from_detection(seen)
    assert isinstance(measurement, kind)
    assert measurement.bearing_rad == 0.5


def test_covariance_of_another_shape_is_rejected() -> None:
    with pytest.raises(DomainError, match=r"\(2, 2\)"):
        RangeBearing(1.0, 0.0, np.eye(3))


@pytest.mark.parametrize(("dof", "threshold"), [(1, 6.63490), (2, 9.21034)])
def test_paper_gate_has_the_quantiles_of_chi_square(dof: int, threshold: float) -> None:
    assert PAPER_GATE.threshold(dof) == pytest.approx(threshold, abs=5e-6)


@pytest.mark.parametrize("size", [1, 2])
def test_open_gate_has_no_threshold(size: int) -> None:
    assert OPEN_GATE.threshold(size) == math.inf


LANDMARK = LandmarkPosition("l", 2.0, 1.0)
MEASUREMENT_COVARIANCE = np.diag([0.04, 0.002])
NOISE = MotionNoise(0.01, 0.001, 0.0005, 0.0064)


def make_belief(scale: float = 1.0) -> Belief:
    factor = np.array([[0.3, 0.0, 0.0], [0.1, 0.2, 0.0], [0.05, -0.1, 0.1]])
    return Belief(np.array([0.2, -0.1, 0.5]), scale * factor @ factor.T)


def make_measurement(belief: Belief, *, range_error_m: float = 0.0, bearing_error_rad: float = 0.0):
    expected, _ = predict_measurement(belief.mean, LANDMARK)
    bearing = expected.bearing_rad + bearing_error_rad
    return RangeBearing(expected.range_m + range_error_m, bearing, MEASUREMENT_COVARIANCE)


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
    measured = RangeBearing(2.0, math.pi - 1e-3, MEASUREMENT_COVARIANCE)
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
    (RangeBearing(math.nan, 0.0, MEASUREMENT_COVARIANCE), LANDMARK, UpdateStatus.NOT_FINITE),
    (RangeBearing(1.0, -math.inf, MEASUREMENT_COVARIANCE), LANDMARK, UpdateStatus.NOT_FINITE),
    (BearingOnly(0.0, math.nan), LANDMARK, UpdateStatus.NOT_FINITE),
    (
        RangeBearing(1.0, 0.0, -MEASUREMENT_COVARIANCE),
        LANDMARK,
        UpdateStatus.INVALID_NOISE_COVARIANCE,
    ),
    (BearingOnly(0.0, -0.1), LANDMARK, UpdateStatus.INVALID_NOISE_COVARIANCE),
    (
        RangeBearing(1.0, 0.0, MEASUREMENT_COVARIANCE),
        LandmarkPosition("here", 0.2, -0.1),
        UpdateStatus.AT_LANDMARK,
    ),
    (
        RangeBearing(1.0, 0.0, MEASUREMENT_COVARIANCE),
        LandmarkPosition("near", 0.2, -0.06),
        UpdateStatus.AT_LANDMARK,
    ),
    (RangeBearing(1.0, 0.0, MEASUREMENT_COVARIANCE * 1e308 * 40), LANDMARK, UpdateStatus.OVERFLOW),
]


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")  # the last case is made so
@pytest.mark.parametrize(("measurement", "landmark", "reason"), UNUSABLE_MEASUREMENTS[:-1])
def test_unusable_measurement_is_rejected_with_a_status(measurement, landmark, reason) -> None:
    before = make_belief()
    result = update(before, measurement, landmark=landmark, gate=PAPER_GATE)
    assert result.status is reason
    assert not result.has_innovation
    assert result.belief is before


def test_driving_to_and_fro_without_noise_keeps_a_low_rank_definite() -> None:
    direction = np.array([0.0, 0.1, 0.2])
    belief = Belief(np.zeros(3), np.outer(direction, direction))
    quiet = MotionNoise(0.0, 0.0, 0.0, 0.0)
    for step in range(400):
        belief = predict(belief, Control(0.5 * (-1) ** step, 0.0), noise=quiet)
    assert belief.covariance[1, 1] == pytest.approx(0.01, rel=1e-10)
