"""Properties over the whole domain: hundreds of random numbers from fixed seeds each."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from catoptra_client.landmarks.candidates import (
    range_from_half_angle,
    range_from_slope,
)
from catoptra_client.localization import (
    OPEN_GATE,
    Belief,
    Control,
    LandmarkPosition,
    MotionNoise,
    OdometryPose,
    RangeBearing,
    control_from_odometry,
    predict,
    update,
)
from catoptra_client.localization.ekf import predict_measurement
from catoptra_client.localization.motion_model import propagate_pose
from catoptra_protocol.optics.numerics import (
    TWO_PI,
    angle_difference,
    half_angle_tangent_from_rho_z,
    interpolate_angle,
    wrap_angle,
)

ANY = st.floats(allow_nan=False, allow_infinity=False)
ANGLES = st.floats(-math.pi, math.pi)
METRES = st.floats(-1e3, 1e3)
POSES = st.tuples(METRES, METRES, ANGLES)
NOISE = MotionNoise(0.01, 0.001, 0.0005, 0.0064)
FACTORS = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9)


def many(examples: int):
    """Hypothesis settings: number of examples, deterministic, without a deadline."""
    return settings(derandomize=True, max_examples=examples, deadline=None, database=None)


def off(one: float, other: float) -> float:
    """Difference of two angles modulo a turn."""
    return abs(math.remainder(one - other, TWO_PI))


@many(600)
@given(ANY)
def test_wrap_is_inside_idempotent_and_odd(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert wrap_angle(wrapped) == wrapped
    assert wrap_angle(-angle) == -wrapped or abs(wrapped) == math.pi


@many(600)
@given(ANGLES, ANGLES)
def test_difference_leads_from_one_angle_to_the_other(angle: float, start: float) -> None:
    turn = angle_difference(angle, start)
    assert off(start + turn, angle) <= 1e-15
    assert off(angle_difference(start, angle), -turn) == 0.0


@many(600)
@given(ANGLES, ANGLES, st.floats(0.0, 1.0))
def test_interpolated_angle_lies_on_the_shorter_turn(
    start: float, end: float, fraction: float
) -> None:
    way = angle_difference(end, start)
    turn = angle_difference(interpolate_angle(start, end, fraction=fraction), start)
    assert off(turn, fraction * way) <= 2e-15


@many(600)
@given(POSES, st.floats(-1e3, 1e3), st.floats(-20.0, 20.0))
def test_motion_back_along_the_arc_returns_to_the_start(pose, v: float, turn: float) -> None:
    there = propagate_pose(np.array(pose), Control(v, turn))
    back = propagate_pose(there, Control(-v, -turn))
    assert np.hypot(*(back[:2] - pose[:2])) <= 1e-14 * (1e3 + abs(v))
    assert off(back[2], pose[2]) <= 1e-14


@many(600)
@given(POSES, st.floats(-1e3, 1e3), st.floats(-3.1, 3.1))
def test_control_is_recovered_from_its_poses(pose, v: float, turn: float) -> None:
    there = propagate_pose(np.array(pose), Control(v, turn))
    found = control_from_odometry(OdometryPose(*pose), OdometryPose(*there.tolist()))
    assert abs(found.distance_m - v) <= 1e-12 * (1.0 + abs(v)) + 1e-12
    assert off(found.turn_rad, turn) <= 1e-14


@many(600)
@given(POSES, METRES, METRES)
def test_measurement_leads_back_to_its_landmark(pose, x: float, y: float) -> None:
    seen, valid = predict_measurement(np.array(pose), LandmarkPosition("l", x, y))
    assume(valid)
    direction = pose[2] + seen.bearing_rad
    back = (
        pose[0] + seen.range_m * math.cos(direction),
        pose[1] + seen.range_m * math.sin(direction),
    )
    assert math.hypot(back[0] - x, back[1] - y) <= 3e-12
    assert -math.pi < seen.bearing_rad <= math.pi


@many(600)
@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.sampled_from([1.0, -1.0]))
def test_range_comes_back_from_its_angle(range_m: float, drop_m: float, side: float) -> None:
    t, _ = half_angle_tangent_from_rho_z(np.array(range_m), np.array(side * drop_m))
    back, valid = range_from_half_angle(float(t), drop_m=side * drop_m)
    # t is rounded once: near the horizon an ulp of it is a step in range.
    condition = range_m / drop_m + drop_m / range_m
    assert valid
    assert abs(back - range_m) <= 1e-15 * condition * range_m * 2.0


@many(600)
@given(ANY, ANY)
def test_range_of_any_slope_is_a_number_or_invalid(slope: float, drop_m: float) -> None:
    for range_m, valid in (
        range_from_slope(slope, drop_m=drop_m),
        range_from_half_angle(slope, drop_m=drop_m),
    ):
        assert math.isfinite(range_m)
        assert range_m >= 0.0
        assert valid or range_m == 0.0


def belief_of(pose, factors: list[float], *, scale: float) -> Belief:
    """Belief whose covariance is the square of a random matrix."""
    root = scale * np.array(factors).reshape(3, 3)
    return Belief(np.array(pose), root @ root.T)


def off_by(one: Belief, other: Belief, prior: Belief) -> float:
    """Largest difference of two covariances in units of the prior's sigmas."""
    sigma = np.sqrt(np.maximum(np.diagonal(prior.covariance), 1e-30))
    return float(np.abs((one.covariance - other.covariance) / np.outer(sigma, sigma)).max())


@many(500)
@given(POSES, FACTORS, st.floats(0.1, 10.0), st.floats(0.1, 10.0), ANGLES, ANGLES)
def test_order_of_updates_does_not_matter(pose, factors, near, far, left, right) -> None:
    """Without innovations the filter is linear: two measurements commute but for rounding."""
    prior = belief_of(pose, factors, scale=0.1)
    marks = [(near, left), (far, right)]
    both = []
    for order in (marks, marks[::-1]):
        belief = prior
        for range_m, azimuth in order:
            place = pose[0] + range_m * math.cos(azimuth), pose[1] + range_m * math.sin(azimuth)
            landmark = LandmarkPosition("l", *place)
            seen, _ = predict_measurement(belief.mean, landmark)
            measured = RangeBearing(seen.range_m, seen.bearing_rad, np.diag([0.01, 1e-3]))
            belief = update(belief, measured, landmark=landmark, gate=OPEN_GATE).belief
        both.append(belief)
    np.testing.assert_allclose(both[0].mean, both[1].mean, rtol=0, atol=1e-12)
    assert off_by(both[0], both[1], prior) <= 1e-9


@many(500)
@given(POSES, FACTORS, st.floats(-150.0, 100.0), ANY, ANY, st.floats(-300.0, 300.0))
def test_update_with_anything_leaves_a_belief(pose, factors, scale, r, gamma, noise) -> None:
    prior = belief_of(pose, factors, scale=10.0**scale)
    measured = RangeBearing(r, gamma, 10.0**noise * np.eye(2))
    landmark = LandmarkPosition("l", pose[0] + 1.0, pose[1])
    result = update(prior, measured, landmark=landmark, gate=OPEN_GATE)
    for array in (result.belief.mean, result.belief.covariance, result.innovation):
        assert np.isfinite(array).all()
    assert math.isfinite(result.nis)
    assert result.is_accepted or result.belief is prior


@many(500)
@given(POSES, FACTORS, st.floats(-100.0, 100.0), st.floats(-20.0, 20.0))
def test_noise_of_motion_only_adds_to_a_prediction(pose, factors, v, turn) -> None:
    prior = belief_of(pose, factors, scale=0.1)
    after = predict(prior, Control(v, turn), noise=NOISE)
    quiet = predict(prior, Control(v, turn), noise=MotionNoise(0.0, 0.0, 0.0, 0.0))
    added = np.diagonal(after.covariance) - np.diagonal(quiet.covariance)
    assert (added >= -1e-12 * np.diagonal(after.covariance)).all()
    assert np.array_equal(after.covariance, after.covariance.T)
