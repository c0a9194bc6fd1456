"""The route round the field has the paper's shape and length."""

from __future__ import annotations

import math

import pytest

from catoptra_studies.experiment.route import clockwise_route, counter_clockwise_route


@pytest.mark.parametrize("route", [clockwise_route(), counter_clockwise_route()])
def test_route_has_a_start_and_a_hundred_steps(route):
    assert len(route) == 101


@pytest.mark.parametrize("route", [clockwise_route(), counter_clockwise_route()])
def test_perimeter_returns_to_its_start_before_the_diagonal(route):
    start, back = route[0], route[84]
    assert (back.x_m, back.y_m) == pytest.approx((start.x_m, start.y_m), abs=1e-12)
    assert math.cos(back.yaw_rad - start.yaw_rad) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("route", [clockwise_route(), counter_clockwise_route()])
def test_diagonal_ends_in_the_opposite_corner(route):
    assert (route[-1].x_m, route[-1].y_m) == pytest.approx((-route[0].x_m, -route[0].y_m))


def test_first_corner_is_reached_with_step_23():
    route = clockwise_route()
    assert route[23].yaw_rad == pytest.approx(0.0)
    assert route[24].yaw_rad == pytest.approx(math.pi / 4)


def test_direction_of_turning_is_clockwise_as_seen_from_above():
    # SAE: yaw grows clockwise; the first turn of the clockwise route is to the right.
    assert clockwise_route()[24].yaw_rad > 0.0
    route = counter_clockwise_route()
    assert math.sin(route[24].yaw_rad - route[23].yaw_rad) < 0.0
