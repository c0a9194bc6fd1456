from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import (
    NO_EFFECT_SETTINGS,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
    needs_radiance_only,
    needs_scene_geometry,
)
from catoptra_server.effects.effect_plan import NO_EFFECTS, plan_effects
from catoptra_server.effects.medium.fog import Fog
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene_summary import NUM_RINGS, SceneSummary
from catoptra_server.effects.sensor.blooming import Blooming
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.scene.twist import Twist
from helpers.effect_measurement import CAMERA

DAYLIGHT = SceneSummary(1.0)
FINE, COARSE = Quantisation(12), Quantisation(8)


def make_settings(*pairs: tuple[object, EffectMode], threshold: float = 0.5) -> EffectSettings:
    return EffectSettings(tuple(EffectSetting(*pair) for pair in pairs), threshold)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("effect", "mode", "is_on"),
    [
        (COARSE, EffectMode.AUTO, True),
        (FINE, EffectMode.AUTO, False),
        (FINE, EffectMode.ALWAYS, True),
        (COARSE, EffectMode.NEVER, False),
    ],
)
def test_effect_runs_when_the_scene_or_the_file_says_so(
    effect: Quantisation, mode: EffectMode, is_on: bool
) -> None:
    plan = plan_effects(make_settings((effect, mode)), DAYLIGHT, CAMERA)
    assert plan.decisions[0].enabled is is_on
    assert plan.image_effects == ((effect,) if is_on else ())


def test_reason_when_the_file_decides_says_so_and_the_bound_stays() -> None:
    (decision,) = plan_effects(
        make_settings((COARSE, EffectMode.NEVER)), DAYLIGHT, CAMERA
    ).decisions
    assert decision.reason.startswith("never by the robot's file; ")
    assert decision.bound > decision.threshold == 0.5


def test_threshold_when_the_user_moves_it_decides() -> None:
    assert plan_effects(
        make_settings((FINE, EffectMode.AUTO), threshold=0.1), DAYLIGHT, CAMERA
    ).image_effects == (FINE,)


def test_threshold_when_in_pixels_decides_on_what_is_told_in_pixels() -> None:
    passing = replace(
        DAYLIGHT, min_distances_m=(1.0,) * NUM_RINGS, scene_twist=Twist((0.5, 0.0, 0.0))
    )
    named = (
        EffectSetting(MotionBlur(0.1), EffectMode.AUTO),
        EffectSetting(COARSE, EffectMode.AUTO),
    )
    bound = plan_effects(EffectSettings(named), passing, CAMERA).find_bound("MotionBlur")
    for threshold_px, is_on in ((0.99 * bound, True), (1.01 * bound, False)):
        plan = plan_effects(EffectSettings(named, threshold_px=threshold_px), passing, CAMERA)
        assert [one.enabled for one in plan.decisions] == [is_on, True]
        assert plan.decisions[0].threshold == threshold_px


def test_bound_when_an_effect_runs_before_is_that_of_what_reaches_it() -> None:
    bloom, longer = Blooming(0.1, 8.0), Exposure(0.04, 0.02)
    alone = plan_effects(make_settings((bloom, EffectMode.AUTO)), DAYLIGHT, CAMERA)
    behind = plan_effects(
        make_settings((longer, EffectMode.AUTO), (bloom, EffectMode.AUTO)), DAYLIGHT, CAMERA
    )
    left_out = plan_effects(
        make_settings((longer, EffectMode.NEVER), (bloom, EffectMode.AUTO)), DAYLIGHT, CAMERA
    )
    assert [plan.image_effects for plan in (alone, behind, left_out)] == [(), (longer, bloom), ()]


def test_decision_when_nothing_changed_is_not_made_again() -> None:
    asked = make_settings((COARSE, EffectMode.AUTO))
    assert plan_effects(asked, DAYLIGHT, CAMERA) is plan_effects(asked, SceneSummary(1.0), CAMERA)


DEMANDING_SCENE = SceneSummary(
    DAYLIGHT.max_radiance,
    min_distances_m=(0.2,) * NUM_RINGS,
    max_distance_m=3.0,
    scene_twist=Twist((1.0, 0.5, 0.0), (0.0, 0.3, 2.0)),
    max_object_rates_rad_s=(1.0,) * NUM_RINGS,
    ego_body_max_angle_rad=0.5,
    ego_body_min_distances_m=(0.1,) * NUM_RINGS,
)


@pytest.mark.parametrize("kind", EFFECT_TYPES, ids=lambda kind: kind.name)
def test_bound_is_of_light_alone_where_an_effect_says_that_it_asks_for_no_more(
    kind: EffectType,
) -> None:
    effect = kind.factory(**{p.field: p.default for p in kind.parameters})
    is_same = effect.bound(DAYLIGHT, CAMERA) == effect.bound(DEMANDING_SCENE, CAMERA)
    assert is_same or needs_scene_geometry(effect)


def test_light_is_enough_until_an_effect_looks_at_what_pixels_see() -> None:
    assert needs_radiance_only(make_settings((COARSE, EffectMode.AUTO)))
    assert not needs_radiance_only(
        make_settings((COARSE, EffectMode.AUTO), (Fog(0.1, 1, 1, 1), EffectMode.NEVER))
    )


def test_plan_when_no_effect_is_named_is_empty_and_says_so() -> None:
    assert plan_effects(NO_EFFECT_SETTINGS, DAYLIGHT, CAMERA) == NO_EFFECTS
    assert "no effects" in str(NO_EFFECTS)


def test_plan_when_printed_is_a_table_with_a_row_an_effect() -> None:
    head, row = str(
        plan_effects(make_settings((FINE, EffectMode.AUTO)), DAYLIGHT, CAMERA)
    ).splitlines()
    assert head.split() == ["effect", "bound", "threshold", "unit", "ms", "reason"]
    assert row.split()[:4] == ["Quantisation", "off", "0.402", "0.5"]
    assert row.endswith("a converter of 12 bits")
