"""Numbers are rounded outward, by less than a step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.effects.bounds.coordinate_rounding import (
    MIN_DISTANCE_M,
    POINT_M,
    ViewpointCells,
    round_away_from_zero,
    round_down,
    round_twist,
)
from catoptra_server.world.world_description import AT_REST, Twist

VALUES = [*np.geomspace(1e-5, 1e5, 101).tolist(), 1.0, 0.5, 2.0 ** (3 / 8)]
STEP = 2.0**0.125 * (1.0 + 1e-12)


def test_distances_are_rounded_down_by_less_than_a_step() -> None:
    for value, rounded in zip(VALUES, round_down(VALUES), strict=True):
        assert rounded <= value * (1.0 + 1e-15)
        assert value < rounded * STEP


def test_rates_are_rounded_up_by_less_than_a_step_whatever_their_sign() -> None:
    for value, rounded in zip(VALUES, round_away_from_zero(VALUES), strict=True):
        assert value * (1.0 - 1e-15) <= rounded < value * STEP
    assert round_away_from_zero([-v for v in VALUES]) == tuple(
        -v for v in round_away_from_zero(VALUES)
    )


def test_distance_zero_rounds_to_the_minimum() -> None:
    assert round_down([0.0, math.inf]) == (MIN_DISTANCE_M, math.inf)


@pytest.mark.parametrize("value", [0.0, -0.0, 1e-17, -1e-17])
def test_rates_of_rounding_size_are_zero(value: float) -> None:
    assert round_away_from_zero([value]) == (0.0,)


def test_similar_twists_round_to_one() -> None:
    one = round_twist(Twist((0.501, 0.0, -1e-12), (0.0, 0.0, -0.31)))
    assert one == round_twist(Twist((0.502, 0.0, 0.0), (0.0, 0.0, -0.311)))
    assert one.linear_m_s[0] >= 0.502
    assert one.angular_rad_s[2] <= -0.311
    assert round_twist(AT_REST) == AT_REST


def test_viewpoints_of_a_cell_share_one_evaluation_and_others_have_their_own() -> None:
    # No cell is allowed beyond x = 10, where each viewpoint is evaluated alone.
    cells = ViewpointCells(
        (0.5, 0.25), lambda c, s: (*c, *s) if c[0] < 10 or s[0] == POINT_M else None
    )
    found = {cells.find(np.array((x, 0.1, -0.6))) for x in (0.8, 1.0, 1.2)}
    assert found == {(1.0, 0.0, -0.625, 0.5, 0.5, 0.0625)}
    assert cells.num_evaluations == 1
    # To a nanometre: a viewpoint that moves by rounding alone is the same one.
    (alone,) = {cells.find(np.array((x, 0.1, -0.6))) for x in (20.1, 20.1 + 1e-14)}
    assert alone == pytest.approx((20.1, 0.1, -0.6, 0.0, 0.0, 0.0), abs=POINT_M)
    assert cells.num_evaluations == 4
