from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.effects.decide import EffectPlan, decide
from catoptra_server.effects.effect import Criterion, EffectWishes, Mode, Wish
from catoptra_server.effects.motion_blur import MotionBlur
from catoptra_server.effects.own_body import OwnBody
from catoptra_server.effects.rolling_shutter import RollingShutter
from catoptra_server.effects.scene_summary import RINGS, SceneSummary
from catoptra_server.effects.shadows import Shadows
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.staging import scene_motion, staged
from catoptra_server.scene.motion import AT_REST, Twist
from helpers.effects import BODY, CAMERA, EXPOSURE
from helpers.motion import after, seen_motion


def plan_of(*effects: Criterion, exposure: Exposure = EXPOSURE) -> EffectPlan:
    """Return a plan by which all of some effects run."""
    summary = SceneSummary(1.0, (1.0,) * RINGS, motion=scene_motion(exposure))
    wishes = EffectWishes(tuple(Wish(effect, Mode.ALWAYS) for effect in effects))
    return decide(wishes, summary, CAMERA)


def test_own_body_when_asked_for_is_seen_after_all_others() -> None:
    own = replace(BODY, world_from_body=Pose.from_rpy((0, 0, 0)))
    exposure = replace(EXPOSURE, own_body=own)
    assert staged(exposure, plan_of()).bodies == (BODY,)
    assert staged(exposure, plan_of(OwnBody())).bodies == (BODY, own)
    assert staged(EXPOSURE, plan_of(OwnBody())).bodies == (BODY,)


def test_shadows_when_asked_for_are_cast() -> None:
    assert not staged(EXPOSURE, plan_of()).has_shadows
    assert staged(EXPOSURE, plan_of(Shadows())).has_shadows


def test_shutter_when_things_move_has_the_slots_that_both_ways_need() -> None:
    blur, rows = MotionBlur(0.04), RollingShutter(0.03)
    plan = plan_of(blur, rows)
    shutter = staged(EXPOSURE, plan).shutter
    assert shutter is not None
    assert (shutter.exposure_s, shutter.readout_s) == (0.04, 0.03)
    way_px = plan.bound("MotionBlur") + 8.0 * plan.bound("RollingShutter")
    assert shutter.instants == pytest.approx(way_px, abs=1.0)
    assert shutter.instants > 2


def test_shutter_when_nothing_moves_is_none() -> None:
    still = replace(EXPOSURE, twist=AT_REST)
    assert staged(still, plan_of(MotionBlur(0.04), exposure=still)).shutter is None
    assert staged(EXPOSURE, plan_of()).shutter is None


@pytest.mark.parametrize("twist", [AT_REST, Twist((0.0, -0.6, 0.0), (0.3, 0.0, 1.0))])
def test_motion_when_seen_is_how_points_move_in_the_mirror_frame(twist: Twist) -> None:
    body, step_s = replace(BODY, twist=twist), 1e-6
    point = np.array((1.1, 0.4, -0.2))
    velocity = twist.at(point - body.world_from_body.translation).linear_m_s
    local = EXPOSURE.world_from_mirror.inverse().points(point)
    later = after(EXPOSURE, step_s).world_from_mirror.inverse()
    moved = later.points(point + step_s * np.asarray(velocity))
    seen = seen_motion(EXPOSURE, body).at(local)
    np.testing.assert_allclose(seen.linear_m_s, (moved - local) / step_s, atol=1e-5)


def test_motion_of_the_scene_is_that_of_a_body_at_rest() -> None:
    alone, body = scene_motion(EXPOSURE), seen_motion(EXPOSURE, replace(BODY, twist=AT_REST))
    np.testing.assert_allclose(alone.linear_m_s, body.linear_m_s, atol=1e-15)
    np.testing.assert_allclose(alone.angular_rad_s, body.angular_rad_s, atol=1e-15)
    assert scene_motion(replace(EXPOSURE, twist=AT_REST)) == AT_REST
