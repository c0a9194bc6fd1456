"""Consistency of a filter, its health, and recoveries."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from catoptra_client.localization import (
    OPEN_GATE,
    Belief,
    Control,
    FilterHealth,
    LandmarkPosition,
    MeasurementUpdate,
    MotionNoise,
    RangeBearing,
    Recovery,
    UpdateStatus,
    apply_recovery,
    chi_square_mean_interval,
    nees,
    predict,
    update,
    update_health,
)
from catoptra_client.localization.ekf import predict_measurement
from catoptra_client.localization.motion_model import control_covariance, propagate_pose
from catoptra_protocol.errors import DomainError

LANDMARKS = [LandmarkPosition(f"l{i}", x, y) for i, (x, y) in enumerate([(3, 2), (-3, 2), (0, -3)])]
NOISE = MotionNoise(0.01, 0.001, 0.001, 0.0064)
R = np.diag([0.05**2, math.radians(1.0) ** 2])
P0 = np.diag([0.05**2, 0.05**2, math.radians(3.0) ** 2])
STEPS = 40


def simulate_run(seed: int, *, noise_scale: float) -> tuple[list[float], list[float]]:
    """NEES and NIS along a circle; true noise is 1 / sqrt(believed) of the assumed noise."""
    rng = np.random.default_rng(seed)
    truth = rng.multivariate_normal(np.zeros(3), P0)
    belief = Belief(np.zeros(3), P0 * noise_scale)
    alphas = MotionNoise(*(noise_scale * a for a in (0.01, 0.001, 0.001, 0.0064)))
    all_nees, all_nis = [], []
    for step in range(STEPS):
        control = Control(0.2, 0.1)
        noise = np.sqrt(np.diagonal(control_covariance(control, NOISE))) * rng.normal(size=2)
        truth = propagate_pose(
            truth, Control(control.distance_m + noise[0], control.turn_rad + noise[1])
        )
        belief = predict(belief, control, noise=alphas)
        landmark = LANDMARKS[step % 3]
        seen = predict_measurement(truth, landmark)[0]
        off = np.sqrt(np.diagonal(R)) * rng.normal(size=2)
        measured = RangeBearing(seen.range_m + off[0], seen.bearing_rad + off[1], R * noise_scale)
        result = update(belief, measured, landmark=landmark, gate=OPEN_GATE)
        belief = result.belief
        all_nis.append(result.nis)
        all_nees.append(nees(belief, truth)[0])
    return all_nees, all_nis


@functools.cache
def simulate_matched_runs(num_runs: int) -> np.ndarray:
    """NEES and NIS (runs, 2, steps) of a filter that assumes the true noise."""
    print(f"seeds 0 to {num_runs - 1}")
    return np.array([simulate_run(seed, noise_scale=1.0) for seed in range(num_runs)])


@pytest.mark.parametrize("runs", [50, 100])
@pytest.mark.parametrize(("row", "size"), [(0, 3), (1, 2)], ids=["NEES", "NIS"])
def test_matched_noise_keeps_nees_and_nis_inside_their_intervals(runs, row, size) -> None:
    low, high = chi_square_mean_interval(size, runs)
    mean = simulate_matched_runs(100)[:runs, row].mean(axis=0)
    inside = ((mean > low) & (mean < high)).mean()
    # Four steps in five, not 95 %: neighbouring steps are correlated. Of twelve hundreds of seeds
    # the worst has 87.5 %, these; all together have NEES 3.01 +- 0.02 and NIS 1.98 +- 0.01.
    assert inside >= 0.8, f"{inside:.0%} of the steps inside {low:.3f} .. {high:.3f}"
    # A run's steps are correlated: the mean of 50 runs scatters by 5 %.
    assert mean.mean() == pytest.approx(size, rel=0.12)


def test_overconfident_filter_leaves_the_interval() -> None:
    results = np.array([simulate_run(seed, noise_scale=1.0 / 2.25) for seed in range(20)])
    assert results[:, 0].mean() > chi_square_mean_interval(3, 20)[1]
    assert results[:, 1].mean() == pytest.approx(2.25 * 2, rel=0.1)


BELIEF = Belief(np.zeros(3), np.zeros((3, 3)))


def make_update(status: UpdateStatus, nis: float = 0.0) -> MeasurementUpdate:
    return MeasurementUpdate(BELIEF, status, np.zeros(2), np.eye(2), nis)


ACCEPTED, REJECTED = (
    make_update(UpdateStatus.ACCEPTED, 1.0),
    make_update(UpdateStatus.OUTSIDE_GATE, 20.0),
)
NOT_FINITE = make_update(UpdateStatus.NOT_FINITE)


@pytest.mark.parametrize(
    ("updates", "streak"),
    [
        ([REJECTED], 2),
        # Without a comparison there is no evidence; one acceptance ends the streak.
        ([], 1),
        ([NOT_FINITE], 1),
        ([REJECTED, ACCEPTED], 0),
    ],
)
def test_streak_counts_steps_with_rejections_only(updates, streak: int) -> None:
    health = update_health(FilterHealth(), [REJECTED, REJECTED])
    assert update_health(health, updates).rejection_streak == streak


def test_windowed_nis_is_per_degree_of_freedom_and_forgets() -> None:
    health = FilterHealth(window_size=2)
    for _ in range(5):
        health = update_health(health, [REJECTED])
    assert health.windowed_nis == 10.0
    assert update_health(health, [ACCEPTED, ACCEPTED]).windowed_nis == 0.5


def test_empty_health_is_healthy() -> None:
    assert (FilterHealth().windowed_nis, FilterHealth().acceptance_rate) == (0.0, 1.0)


def test_every_reason_is_counted() -> None:
    health = update_health(
        update_health(FilterHealth(), [ACCEPTED, NOT_FINITE]), [REJECTED, ACCEPTED, ACCEPTED]
    )
    assert health.status_counts == {
        UpdateStatus.ACCEPTED: 3,
        UpdateStatus.OUTSIDE_GATE: 1,
        UpdateStatus.NOT_FINITE: 1,
    }
    assert health.acceptance_rate == 0.75


def test_recovery_waits_for_its_streak_then_widens_once() -> None:
    health = FilterHealth(rejection_streak=4)
    assert apply_recovery(BELIEF, health, recovery=Recovery())[0] is BELIEF
    belief, reset = apply_recovery(BELIEF, FilterHealth(rejection_streak=5), recovery=Recovery())
    expected = [0.09, 0.09, math.radians(10) ** 2]
    np.testing.assert_allclose(np.diagonal(belief.covariance), expected)
    assert reset.rejection_streak == 0


def test_window_without_room_is_rejected() -> None:
    with pytest.raises(DomainError, match="at least one"):
        FilterHealth(window_size=0)


@pytest.mark.parametrize(
    "wrong",
    [{"min_rejection_streak": 0}, {"position_sigma_m": math.nan}, {"heading_sigma_rad": 1e200}],
)
def test_invalid_recovery_is_rejected(wrong) -> None:
    with pytest.raises(DomainError, match="recovery"):
        Recovery(**wrong)
