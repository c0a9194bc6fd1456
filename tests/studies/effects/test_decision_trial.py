from __future__ import annotations

from catoptra_server.effects import EFFECT_TYPES
from catoptra_studies.effects.decision_experiment import MOTIONS, TrialWorld


def test_place_has_all_motions_and_all_effects_that_are_not_switched_off() -> None:
    world = TrialWorld("rescue", width_px=48)
    (place,) = world.choose_places(1, seed=0)
    decisions = list(world.run(place))
    assert list(dict.fromkeys(one.motion for one in decisions)) == list(MOTIONS)
    names = [one.effect for one in decisions if one.motion == "driving"]
    in_order = [kind.name for kind in EFFECT_TYPES if kind.name in names]
    assert names == in_order
    # Automatic exposure is never on in the shipped camera; one of the two defocus effects acts.
    assert len(names) >= 20
    assert "AutoExposure" not in names
    assert decisions == list(world.run(place)), "a trial repeats itself"
    world.close()


def test_truth_of_motion_follows_the_motion() -> None:
    world = TrialWorld("four_legged_2006", width_px=64)
    (place,) = world.choose_places(1, seed=0)
    truths = {one.motion: one.truth for one in world.run(place) if one.effect == "MotionBlur"}
    assert truths["at rest"] == 0.0
    assert truths["driving"] > 1.0
    world.close()
