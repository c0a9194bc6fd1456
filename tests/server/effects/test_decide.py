from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_server.effects import EFFECTS
from catoptra_server.effects.bloom import Bloom
from catoptra_server.effects.decide import NO_EFFECTS, decide
from catoptra_server.effects.effect import (
    NO_WISHES,
    EffectWishes,
    Kind,
    Mode,
    Wish,
    asks_for_more_than_light,
    light_is_enough,
)
from catoptra_server.effects.exposure import Exposure
from catoptra_server.effects.fog import Fog
from catoptra_server.effects.motion_blur import MotionBlur
from catoptra_server.effects.quantisation import Quantisation
from catoptra_server.effects.scene_summary import RINGS, SceneSummary
from catoptra_server.scene.motion import Twist
from helpers.effects import CAMERA

DAY = SceneSummary(1.0)
FINE, COARSE = Quantisation(12), Quantisation(8)


def wishes(*pairs: tuple[object, Mode], threshold: float = 0.5) -> EffectWishes:
    return EffectWishes(tuple(Wish(*pair) for pair in pairs), threshold)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("effect", "mode", "is_on"),
    [
        (COARSE, Mode.AUTO, True),
        (FINE, Mode.AUTO, False),
        (FINE, Mode.ALWAYS, True),
        (COARSE, Mode.NEVER, False),
    ],
)
def test_effect_runs_when_the_scene_or_the_file_says_so(
    effect: Quantisation, mode: Mode, is_on: bool
) -> None:
    plan = decide(wishes((effect, mode)), DAY, CAMERA)
    assert plan.decisions[0].is_on is is_on
    assert plan.active == ((effect,) if is_on else ())


def test_reason_when_the_file_decides_says_so_and_the_bound_stays() -> None:
    (decision,) = decide(wishes((COARSE, Mode.NEVER)), DAY, CAMERA).decisions
    assert decision.reason.startswith("never by the robot's file; ")
    assert decision.bound > decision.threshold == 0.5


def test_threshold_when_the_user_moves_it_decides() -> None:
    assert decide(wishes((FINE, Mode.AUTO), threshold=0.1), DAY, CAMERA).active == (FINE,)


def test_threshold_when_in_pixels_decides_on_what_is_told_in_pixels() -> None:
    passing = replace(DAY, nearest_m=(1.0,) * RINGS, motion=Twist((0.5, 0.0, 0.0)))
    named = (Wish(MotionBlur(0.1), Mode.AUTO), Wish(COARSE, Mode.AUTO))
    bound = decide(EffectWishes(named), passing, CAMERA).bound("MotionBlur")
    for threshold_px, is_on in ((0.99 * bound, True), (1.01 * bound, False)):
        plan = decide(EffectWishes(named, threshold_px=threshold_px), passing, CAMERA)
        assert [one.is_on for one in plan.decisions] == [is_on, True]
        assert plan.decisions[0].threshold == threshold_px


def test_bound_when_an_effect_runs_before_is_that_of_what_reaches_it() -> None:
    bloom, longer = Bloom(0.1, 8.0), Exposure(0.04, 0.02)
    alone = decide(wishes((bloom, Mode.AUTO)), DAY, CAMERA)
    behind = decide(wishes((longer, Mode.AUTO), (bloom, Mode.AUTO)), DAY, CAMERA)
    left_out = decide(wishes((longer, Mode.NEVER), (bloom, Mode.AUTO)), DAY, CAMERA)
    assert [plan.active for plan in (alone, behind, left_out)] == [(), (longer, bloom), ()]


def test_decision_when_nothing_changed_is_not_made_again() -> None:
    asked = wishes((COARSE, Mode.AUTO))
    assert decide(asked, DAY, CAMERA) is decide(asked, SceneSummary(1.0), CAMERA)


BUSY = SceneSummary(
    DAY.largest_radiance,
    nearest_m=(0.2,) * RINGS,
    farthest_m=3.0,
    motion=Twist((1.0, 0.5, 0.0), (0.0, 0.3, 2.0)),
    passing_rad_s=(1.0,) * RINGS,
    own_body_rad=0.5,
    own_body_m=(0.1,) * RINGS,
)


@pytest.mark.parametrize("kind", EFFECTS, ids=lambda kind: kind.name)
def test_bound_is_of_light_alone_where_an_effect_says_that_it_asks_for_no_more(kind: Kind) -> None:
    effect = kind.make(**{p.field: p.default for p in kind.parameters})
    is_same = effect.bound(DAY, CAMERA) == effect.bound(BUSY, CAMERA)
    assert is_same or asks_for_more_than_light(effect)


def test_light_is_enough_until_an_effect_looks_at_what_pixels_see() -> None:
    assert light_is_enough(wishes((COARSE, Mode.AUTO)))
    assert not light_is_enough(wishes((COARSE, Mode.AUTO), (Fog(0.1, 1, 1, 1), Mode.NEVER)))


def test_plan_when_no_effect_is_named_is_empty_and_says_so() -> None:
    assert decide(NO_WISHES, DAY, CAMERA) == NO_EFFECTS
    assert "no effects" in str(NO_EFFECTS)


def test_plan_when_printed_is_a_table_with_a_row_an_effect() -> None:
    head, row = str(decide(wishes((FINE, Mode.AUTO)), DAY, CAMERA)).splitlines()
    assert head.split() == ["effect", "bound", "threshold", "unit", "ms", "reason"]
    assert row.split()[:4] == ["Quantisation", "off", "0.402", "0.5"]
    assert row.endswith("a converter of 12 bits")
