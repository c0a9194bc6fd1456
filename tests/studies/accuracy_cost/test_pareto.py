from __future__ import annotations

import itertools

import pytest

from catoptra_studies.accuracy_cost.cost_results import pareto_front

POINTS = ((1.0, 9.0), (2.0, 9.0), (3.0, 4.0), (2.5, 6.0), (4.0, 5.0), (5.0, 3.9))


def test_front_goes_from_fast_to_exact_without_what_is_beaten() -> None:
    assert pareto_front(POINTS) == (0, 3, 2, 5)


def test_front_when_a_least_gain_is_asked_for_leaves_out_what_gains_less() -> None:
    assert pareto_front(POINTS, min_gain=0.05) == (0, 3, 2)


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_front_does_not_depend_on_the_order(order: tuple[int, ...]) -> None:
    four = POINTS[:4]
    shuffled = [four[index] for index in order]
    assert {shuffled[index] for index in pareto_front(shuffled)} == {four[0], four[2], four[3]}


def test_front_when_points_are_equal_has_the_first() -> None:
    assert pareto_front([(1.0, 1.0), (1.0, 1.0)]) == (0,)


def test_front_of_nothing_is_empty() -> None:
    assert pareto_front([]) == ()
