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


@pytest.mark.parametrize(("world", "factor"), [("four_legged_2006", 1.0), ("corridor", 0.9)])
def test_every_number_about_a_frame_holds_in_its_picture(world: str, factor: float) -> None:
    # What is off is left out, what is on is forced off.
    named = [one.effect for one in draw_pair(world, factor)[0].effect_decisions]
    for name in named:
        pair = draw_pair(world, factor, without=name)
        decision = next(one for one in pair[0].effect_decisions if one.effect == name)
        stated = decision.bound if decision.change is None else decision.change
        # Both pictures are rounded to whole levels; cells below the threshold may be plain.
        assert find_differences(pair).max() <= stated + 2.0, (name, decision)
