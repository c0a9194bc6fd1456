"""Health of the filter, and the recovery that a caller may apply."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.localization import (
    Belief,
    FilterHealth,
    MeasurementUpdate,
    Recovery,
    UpdateStatus,
    apply_recovery,
    update_health,
)
from catoptra_protocol.errors import DomainError

BELIEF = Belief(np.zeros(3), np.zeros((3, 3)))


def make_update(status: UpdateStatus, nis: float = 0.0) -> MeasurementUpdate:
    return MeasurementUpdate(BELIEF, status, np.zeros(2), np.eye(2), nis)


ACCEPTED, REJECTED = (
    make_update(UpdateStatus.ACCEPTED, 1.0),
    make_update(UpdateStatus.OUTSIDE_GATE, 20.0),
)
NOT_FINITE = make_update(UpdateStatus.NOT_FINITE)


def test_streak_counts_steps_with_rejections_only() -> None:
    health = update_health(update_health(FilterHealth(), [REJECTED, REJECTED]), [REJECTED])
    assert health.rejection_streak == 2


@pytest.mark.parametrize("updates", [[], [NOT_FINITE]])
def test_steps_without_a_comparison_do_not_touch_the_streak(updates) -> None:
    assert update_health(update_health(FilterHealth(), [REJECTED]), updates).rejection_streak == 1


def test_one_acceptance_ends_the_streak() -> None:
    assert (
        update_health(
            update_health(FilterHealth(), [REJECTED]), [REJECTED, ACCEPTED]
        ).rejection_streak
        == 0
    )


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
