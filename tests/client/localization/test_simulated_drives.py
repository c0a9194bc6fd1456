"""Monte Carlo of the paper's experiment: lock-out, re-lock, recovery.

Set-up and expected values are those of 200 seeds; here 20, so the bounds are wide. Left is negative
(yaw positive to the right); the robot drives clockwise, as in the paper.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import pytest

from catoptra_client.localization import (
    PAPER_GATE,
    Belief,
    Control,
    FilterHealth,
    LandmarkPosition,
    MotionNoise,
    RangeBearing,
    Recovery,
    apply_recovery,
    level_control,
    predict,
    update,
    update_health,
)
from catoptra_client.localization.ekf import predict_measurement
from catoptra_client.localization.motion_model import propagate_pose
from catoptra_protocol.optics.transforms import rotation_from_rpy

NUM_SEEDS = 20
VIEWPOINT_HEIGHT_M, LANDMARK_HEIGHT_M, MAX_RANGE_M = 0.6, 0.3, 2.5
SIGMA_THETA = math.radians(0.554)  # 1 px at the horizon
ALPHAS = (0.10**2, 0.0, 0.023**2, 0.08**2)
R = np.diag([0.40**2, math.radians(2.5) ** 2])
CONSISTENT_P0 = np.diag([0.05**2, 0.05**2, math.radians(6.0) ** 2])
LANDMARKS = [
    LandmarkPosition(f"l{x}{y}", x, y)
    for x, y in [(2.7, 0.0), (-2.7, 0.0), (1.35, 1.9), (1.35, -1.9), (-1.35, 1.9), (-1.35, -1.9)]
]


def make_controls() -> list[Control]:
    """100 true controls: the field's edges clockwise, then the diagonal."""
    corner = [Control(0.0, math.radians(45.0))] * 2
    last = [Control(0.0, 0.5 * (math.pi / 2 + math.atan2(3.0, 4.6)))] * 2
    long_side, short_side = [Control(0.2, 0.0)] * 23, [Control(0.2, 0.0)] * 15
    diagonal = [Control(math.hypot(4.6, 3.0) / 16, 0.0)] * 16
    edges = [*long_side, *corner, *short_side, *corner, *long_side, *corner, *short_side, *last]
    return edges + diagonal


@dataclass(frozen=True)
class SimulatedRun:
    """Errors in metres (100,), and per step accepted and compared measurements (100,)."""

    odometry_m: np.ndarray
    ekf_m: np.ndarray
    num_accepted: np.ndarray
    num_compared: np.ndarray

    def acceptance_rate(self, first: int, last: int) -> float:
        window = slice(first - 1, last)
        return self.num_accepted[window].sum() / max(self.num_compared[window].sum(), 1)

    def relock_step(self) -> int:
        """Step (from 1) of the first acceptance after the longest rejection streak."""
        streak = longest = relocked = 0
        for step, (accepted, compared) in enumerate(
            zip(self.num_accepted, self.num_compared, strict=True)
        ):
            if accepted and streak > longest:
                longest, relocked = streak, step + 1
            streak = 0 if accepted else streak + bool(compared)
        return relocked


def simulate_measurements(truth, rng) -> list[tuple[LandmarkPosition, RangeBearing]]:
    """Landmarks within reach with the noise of a pixel and a degree."""
    seen = []
    for landmark in LANDMARKS:
        expected = predict_measurement(truth, landmark)[0]
        if expected.range_m <= MAX_RANGE_M:
            height = VIEWPOINT_HEIGHT_M - LANDMARK_HEIGHT_M
            sigma = (height**2 + expected.range_m**2) / height * SIGMA_THETA
            range_m = expected.range_m + min(sigma, 0.4) * rng.normal()
            bearing = expected.bearing_rad + math.radians(1.0) * rng.normal()
            seen.append((landmark, RangeBearing(range_m, bearing, R)))
    return seen


def simulate_run(
    seed: int, *, alphas=ALPHAS, start_covariance=None, recovery: Recovery | None = None
) -> SimulatedRun:
    rng = np.random.default_rng(seed)
    truth = np.array([-2.3, -1.5, 0.0])
    start = truth + np.array([0.0, 0.0, math.radians(-5.2)])
    odometry, health = start.copy(), FilterHealth()
    belief = Belief(start, np.zeros((3, 3)) if start_covariance is None else start_covariance)
    rows = []
    for control in make_controls():
        truth = propagate_pose(truth, control)
        felt = Control(1.02 * control.distance_m, control.turn_rad - math.radians(0.23))
        odometry = propagate_pose(odometry, felt)
        belief = predict(belief, felt, noise=MotionNoise(*alphas))
        updates = []
        for landmark, measured in simulate_measurements(truth, rng):
            updates.append(update(belief, measured, landmark=landmark, gate=PAPER_GATE))
            belief = updates[-1].belief
        health = update_health(health, updates)
        if recovery is not None:
            belief, health = apply_recovery(belief, health, recovery=recovery)
        rows.append(
            (
                math.dist(odometry[:2], truth[:2]),
                math.dist(belief.mean[:2], truth[:2]),
                sum(u.is_accepted for u in updates),
                sum(u.has_innovation for u in updates),
            )
        )
    return SimulatedRun(*np.array(rows).T)


@functools.cache
def simulate_all_seeds(filter_name: str) -> tuple[SimulatedRun, ...]:
    settings = {
        "zero": {},
        "honest": {"start_covariance": CONSISTENT_P0},
        "locked out": {"alphas": tuple(alpha / 25 for alpha in ALPHAS)},
        "recovery": {"alphas": tuple(alpha / 25 for alpha in ALPHAS), "recovery": Recovery()},
    }
    return tuple(simulate_run(seed, **settings[filter_name]) for seed in range(NUM_SEEDS))


def median(values) -> float:
    return float(np.median(list(values)))


def test_path_has_a_hundred_steps_and_ends_at_the_far_corner() -> None:
    pose = np.array([-2.3, -1.5, 0.0])
    for control in make_controls():
        pose = propagate_pose(pose, control)
    assert len(make_controls()) == 100
    np.testing.assert_allclose(pose[:2], [2.3, 1.5], atol=1e-12)


def test_odometry_alone_errs_by_more_than_a_metre_for_several_steps() -> None:
    assert median((r.odometry_m > 1.0).sum() for r in simulate_all_seeds("zero")) >= 5


def test_median_run_with_zero_covariance_stays_below_0_6_m() -> None:
    assert median(r.ekf_m.max() for r in simulate_all_seeds("zero")) < 0.6


def test_zero_covariance_rejects_first_and_locks_again_near_the_corner() -> None:
    assert median(r.acceptance_rate(9, 22) for r in simulate_all_seeds("zero")) < 0.5
    assert median(r.acceptance_rate(41, 100) for r in simulate_all_seeds("zero")) > 0.8
    assert abs(median(r.relock_step() for r in simulate_all_seeds("zero")) - 23) <= 3


def test_honest_start_is_accurate_to_a_decimetre() -> None:
    assert median(r.ekf_m.max() for r in simulate_all_seeds("honest")) < 0.10
    assert median(r.acceptance_rate(1, 100) for r in simulate_all_seeds("honest")) > 0.97


def test_small_motion_noise_locks_the_filter_out_for_good() -> None:
    assert median(r.ekf_m.max() for r in simulate_all_seeds("locked out")) > 0.6
    assert median(r.acceptance_rate(23, 40) for r in simulate_all_seeds("locked out")) < 0.5


def test_recovery_ends_the_lock_out() -> None:
    assert median(r.ekf_m[30:].max() for r in simulate_all_seeds("recovery")) < 0.2
    assert max(r.ekf_m[30:].max() for r in simulate_all_seeds("recovery")) < 0.6


def test_level_controls_follow_the_drive_on_a_slope() -> None:
    # An arc on a plane of 20 degrees, in short steps; axes of the robot by turns about its own z.
    slope, control = math.radians(20.0), Control(0.01, 0.01)
    axes, place, pose = rotation_from_rpy(0.0, slope, 0.0), np.zeros(3), np.zeros(3)
    for _ in range(200):
        roll, pitch = math.atan2(axes[2, 1], axes[2, 2]), math.asin(-axes[2, 0])
        pose = propagate_pose(pose, level_control(control, roll_rad=roll, pitch_rad=pitch))
        half = rotation_from_rpy(0.0, 0.0, 0.005)
        place = place + axes @ half[:, 0] * 0.01
        axes = axes @ half @ half
    # A step has the attitude of its start: errors of the order of the step.
    np.testing.assert_allclose(pose[:2], place[:2], atol=3e-3)
    assert pose[2] == pytest.approx(math.atan2(axes[1, 0], axes[0, 0]), abs=2e-3)
    level = level_control(control, roll_rad=0.0, pitch_rad=0.0)
    assert level == control
