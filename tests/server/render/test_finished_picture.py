"""What an effect changes counts in the picture that the user gets, in whatever light."""

from __future__ import annotations

import pytest

from helpers.finished_pictures import draw_pair, find_differences


@pytest.mark.parametrize("factor", [1e-4, 1e-3, 0.1, 8.0])
@pytest.mark.parametrize("world", ["corridor", "warehouse"])
def test_picture_in_other_light_has_all_effects_that_show(world: str, factor: float) -> None:
    assert find_differences(draw_pair(world, factor)).max() <= 2.0


@pytest.mark.parametrize("max_gain", [10.0, 1000.0])
def test_picture_that_exposes_itself_at_night_has_all_effects_that_show(max_gain: float) -> None:
    assert find_differences(draw_pair("rescue", 0.01, max_gain=max_gain)).max() <= 2.0
