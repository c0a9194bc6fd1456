from __future__ import annotations

import math

import pytest

from catoptra_server.effects import (
    NUM_RINGS,
    EffectMode,
    EffectSetting,
    EffectSettings,
    SceneSummary,
)
from catoptra_server.effects.effect_plan import plan_effects
from catoptra_server.effects.scene.self_view import SelfView
from helpers.effect_measurement import CAMERA

AUTO = EffectSettings((EffectSetting(SelfView(), EffectMode.AUTO),))


@pytest.mark.parametrize(
    ("angle_deg", "max_radiance", "is_on"),
    [(0.0, 1.0, False), (0.01, 1.0, True), (150.0, 1.0, True), (47.0, 1e-5, False)],
)
def test_robot_is_drawn_where_any_of_it_may_be_seen(
    angle_deg: float, max_radiance: float, is_on: bool
) -> None:
    summary = SceneSummary(max_radiance, ego_body_max_angle_rad=math.radians(angle_deg))
    plan = plan_effects(AUTO, summary, CAMERA)
    assert plan.decisions[0].enabled is is_on
    assert plan.scene_effects == ((SelfView(),) if is_on else ())
    assert plan.image_effects == ()


def test_reason_when_nothing_of_the_robot_is_visible_states_it() -> None:
    assert SelfView().bound(SceneSummary(1.0), CAMERA).reason == ("no part of the robot is in view")


def test_summary_when_the_robot_is_visible_has_it_near_and_not_passing_by() -> None:
    own = (0.2, 0.3, *[math.inf] * (NUM_RINGS - 2))
    scene = (0.6, 0.25, *[0.7] * (NUM_RINGS - 2))
    behind = SelfView().update_summary(SceneSummary(1.0, scene, ego_body_min_distances_m=own))
    assert behind.visible_min_distances_m == (0.2, 0.25, *[0.7] * (NUM_RINGS - 2))
    assert behind.min_distances_m == scene, "what moves against the camera is no nearer than before"
