"""The filter's health, and the recovery that a caller may switch on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.localization import (
    Belief,
    FilterHealth,
    Reason,
    Recovery,
    Update,
    observe,
    recovered,
)
from catoptra_protocol.errors import DomainError

BELIEF = Belief(np.zeros(3), np.zeros((3, 3)))


def became(reason: Reason, distance_squared: float = 0.0) -> Update:
    return Update(BELIEF, reason, np.zeros(2), np.eye(2), distance_squared)


TAKEN, GATED = became(Reason.ACCEPTED, 1.0), became(Reason.OUTSIDE_GATE, 20.0)
BROKEN = became(Reason.NOT_FINITE)


def test_streak_counts_steps_with_rejections_only() -> None:
    health = observe(observe(FilterHealth(), [GATED, GATED]), [GATED])
    assert health.rejection_streak == 2


@pytest.mark.parametrize("updates", [[], [BROKEN]])
def test_steps_without_a_comparison_do_not_touch_the_streak(updates) -> None:
    assert observe(observe(FilterHealth(), [GATED]), updates).rejection_streak == 1


def test_one_acceptance_ends_the_streak() -> None:
    assert observe(observe(FilterHealth(), [GATED]), [GATED, TAKEN]).rejection_streak == 0


def test_windowed_nis_is_per_degree_of_freedom_and_forgets() -> None:
    health = FilterHealth(window_size=2)
    for _ in range(5):
        health = observe(health, [GATED])
    assert health.windowed_nis == 10.0
    assert observe(health, [TAKEN, TAKEN]).windowed_nis == 0.5


def test_empty_health_is_healthy() -> None:
    assert (FilterHealth().windowed_nis, FilterHealth().acceptance) == (0.0, 1.0)


def test_every_reason_is_counted() -> None:
    health = observe(observe(FilterHealth(), [TAKEN, BROKEN]), [GATED, TAKEN, TAKEN])
    assert health.counts == {Reason.ACCEPTED: 3, Reason.OUTSIDE_GATE: 1, Reason.NOT_FINITE: 1}
    assert health.acceptance == 0.75


def test_recovery_waits_for_its_streak_then_widens_once() -> None:
    health = FilterHealth(rejection_streak=4)
    assert recovered(BELIEF, health, recovery=Recovery())[0] is BELIEF
    belief, reset = recovered(BELIEF, FilterHealth(rejection_streak=5), recovery=Recovery())
    expected = [0.09, 0.09, math.radians(10) ** 2]
    np.testing.assert_allclose(np.diagonal(belief.covariance), expected)
    assert reset.rejection_streak == 0


def test_window_without_room_is_refused() -> None:
    with pytest.raises(DomainError, match="at least one"):
        FilterHealth(window_size=0)


@pytest.mark.parametrize(
    "wrong",
    [{"after_steps": 0}, {"position_sigma_m": math.nan}, {"heading_sigma_rad": 1e200}],
)
def test_recovery_that_cannot_be_is_refused(wrong) -> None:
    with pytest.raises(DomainError, match="recovery"):
        Recovery(**wrong)
