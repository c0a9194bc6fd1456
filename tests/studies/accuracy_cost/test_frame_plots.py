from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.frame_plots import MAX_COLUMNS, select_front_levels
from catoptra_studies.accuracy_cost.level_costs import MeasuredLevel

BLACK = np.zeros((4, 4, 3), dtype=np.uint8)


def make_levels(results: CostResults, times: list[float]) -> list[MeasuredLevel]:
    level = results.levels[0]
    return [
        MeasuredLevel(replace(level, wall_ms=ms, is_on_pareto_front=True), BLACK) for ms in times
    ]


def test_levels_are_those_of_the_front_from_fast_to_exact(results: CostResults) -> None:
    off = MeasuredLevel(replace(results.levels[0], wall_ms=1.0, is_on_pareto_front=False), BLACK)
    found = select_front_levels([off, *make_levels(results, [9.0, 3.0])])
    assert [one.cost.wall_ms for one in found] == [3.0, 9.0]


@pytest.mark.parametrize("count", [1, MAX_COLUMNS, MAX_COLUMNS + 5])
def test_levels_when_too_many_keep_both_ends(results: CostResults, count: int) -> None:
    found = [
        one.cost.wall_ms
        for one in select_front_levels(make_levels(results, [float(n) for n in range(count)]))
    ]
    assert len(found) == min(count, MAX_COLUMNS)
    assert (found[0], found[-1]) == (0.0, count - 1.0)
