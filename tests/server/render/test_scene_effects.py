from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState, scene_twist_in_mirror
from catoptra_server.effects.effect import Effect, EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.effect_plan import EffectPlan, apply_scene_effects, plan_effects
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.effects.scene.shadows import Shadows
from catoptra_server.effects.scene_summary import NUM_RINGS, SceneSummary
from catoptra_server.scene.twist import AT_REST, Twist
from helpers.effect_measurement import CAMERA, DRIVING_STATE, DYNAMIC_OBJECT
from helpers.motion_reference import camera_state_after, relative_twist


def plan_of(*effects: Effect, exposure: CameraState = DRIVING_STATE) -> EffectPlan:
    """Return a plan by which all of some effects run."""
    summary = SceneSummary(1.0, (1.0,) * NUM_RINGS, scene_twist=scene_twist_in_mirror(exposure))
    wishes = EffectSettings(tuple(EffectSetting(effect, EffectMode.ALWAYS) for effect in effects))
    return plan_effects(wishes, summary, CAMERA)


def test_own_body_when_asked_for_is_seen_after_all_others() -> None:
    own = replace(DYNAMIC_OBJECT, world_from_object=Pose.from_rpy((0, 0, 0)))
    exposure = replace(DRIVING_STATE, ego_body=own)
    assert apply_scene_effects(exposure, plan_of()).objects == (DYNAMIC_OBJECT,)
    assert apply_scene_effects(exposure, plan_of(SelfView())).objects == (DYNAMIC_OBJECT, own)
    assert apply_scene_effects(DRIVING_STATE, plan_of(SelfView())).objects == (DYNAMIC_OBJECT,)


def test_shadows_when_asked_for_are_cast() -> None:
    assert not apply_scene_effects(DRIVING_STATE, plan_of()).has_shadows
    assert apply_scene_effects(DRIVING_STATE, plan_of(Shadows())).has_shadows


def test_shutter_when_things_move_has_the_slots_that_both_ways_need() -> None:
    blur, rows = MotionBlur(0.04), RollingShutter(0.03)
    plan = plan_of(blur, rows)
    shutter = apply_scene_effects(DRIVING_STATE, plan).shutter
    assert shutter is not None
    assert (shutter.exposure_s, shutter.readout_s) == (0.04, 0.03)
    way_px = plan.find_bound("MotionBlur") + 8.0 * plan.find_bound("RollingShutter")
    assert shutter.num_time_samples == pytest.approx(way_px, abs=1.0)
    assert shutter.num_time_samples > 2


def test_shutter_when_nothing_moves_is_none() -> None:
    still = replace(DRIVING_STATE, twist=AT_REST)
    assert apply_scene_effects(still, plan_of(MotionBlur(0.04), exposure=still)).shutter is None
    assert apply_scene_effects(DRIVING_STATE, plan_of()).shutter is None


@pytest.mark.parametrize("twist", [AT_REST, Twist((0.0, -0.6, 0.0), (0.3, 0.0, 1.0))])
def test_motion_when_seen_is_how_points_move_in_the_mirror_frame(twist: Twist) -> None:
    body, step_s = replace(DYNAMIC_OBJECT, twist=twist), 1e-6
    point = np.array((1.1, 0.4, -0.2))
    velocity = twist.at_offset(point - body.world_from_object.translation).linear_m_s
    local = DRIVING_STATE.world_from_mirror.inverse().transform_points(point)
    later = camera_state_after(DRIVING_STATE, step_s).world_from_mirror.inverse()
    moved = later.transform_points(point + step_s * np.asarray(velocity))
    seen = relative_twist(DRIVING_STATE, body).at_offset(local)
    np.testing.assert_allclose(seen.linear_m_s, (moved - local) / step_s, atol=1e-5)


def test_motion_of_the_scene_is_that_of_a_body_at_rest() -> None:
    alone, body = (
        scene_twist_in_mirror(DRIVING_STATE),
        relative_twist(DRIVING_STATE, replace(DYNAMIC_OBJECT, twist=AT_REST)),
    )
    np.testing.assert_allclose(alone.linear_m_s, body.linear_m_s, atol=1e-15)
    np.testing.assert_allclose(alone.angular_rad_s, body.angular_rad_s, atol=1e-15)
    assert scene_twist_in_mirror(replace(DRIVING_STATE, twist=AT_REST)) == AT_REST
