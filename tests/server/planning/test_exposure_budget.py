"""Long exposures have as many time samples as the budget of rays allows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.plan.plans import (
    MAX_EXPOSURE_RAYS,
    covered_fraction,
    explain_limit,
    limit_time_samples,
    plan_from_settings,
)
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState, Shutter
from catoptra_server.world.objects import DynamicObject
from helpers.dynamic_objects import ROBOT_MESH, place_cube
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=640)
MOVING = CameraState(Pose.identity(), shutter=Shutter(0.02, 0.0, 1e6))


def make_plan(samples: int) -> RenderPlan:
    settings = RenderSettings(samples=samples)
    return plan_from_settings(settings, CAMERA, kind=RendererKind.TRACE, reason="test")


def count_time_samples(state: CameraState, samples: int) -> int:
    limited = limit_time_samples(state, CAMERA, make_plan(samples))
    assert limited.shutter is not None
    return limited.shutter.num_time_samples


@pytest.mark.parametrize(("samples", "time_samples"), [(1, 64), (2, 20), (4, 5), (8, 2)])
def test_time_samples_fall_with_the_samples_of_the_plan(samples: int, time_samples: int) -> None:
    assert count_time_samples(MOVING, samples) == time_samples


def test_few_time_samples_are_not_changed() -> None:
    calm = replace(MOVING, shutter=Shutter(0.02, 0.0, 4.0))
    assert count_time_samples(calm, 2) == 4


def test_state_without_a_shutter_is_itself() -> None:
    sharp = CameraState(Pose.identity())
    assert limit_time_samples(sharp, CAMERA, make_plan(2)) is sharp


@pytest.mark.parametrize(("distance_m", "time_samples"), [(50.0, 20), (1.0, 19), (0.3, 10)])
def test_near_objects_take_time_samples(distance_m: float, time_samples: int) -> None:
    objects = (place_cube(distance_m, 0.0, 0.0, size_m=0.4),)
    assert count_time_samples(replace(MOVING, objects=objects), 2) == time_samples


def test_many_far_objects_stay_within_the_budget_by_their_triangles() -> None:
    far = DynamicObject(ROBOT_MESH, Pose.from_rpy((90.0, 0.0, 0.0)))
    count = count_time_samples(replace(MOVING, objects=200 * (far,)), 1)
    pixels = CAMERA.width_px * CAMERA.height_px
    assert count < MAX_EXPOSURE_RAYS / (pixels + 200 * 20 * len(ROBOT_MESH))
    assert count >= 2


@pytest.mark.parametrize(
    ("distance_m", "fraction"),
    [(0.0, 1.0), (0.9, 1.0), (1.0 + 1e-12, 0.5), (math.sqrt(2.0), 0.5 - 0.5 * math.sqrt(0.5))],
)
def test_covered_fraction_is_that_of_the_cone_around_the_sphere(
    distance_m: float, fraction: float
) -> None:
    ball = place_cube(distance_m, 0.0, 0.0, size_m=2.0 / math.sqrt(3.0))
    assert ball.mesh.radius_m == pytest.approx(1.0)
    assert covered_fraction(ball, np.zeros(3)) == pytest.approx(fraction, abs=1e-5)


def test_decisions_name_the_limit_at_the_effects_of_the_shutter() -> None:
    decisions = tuple(
        EffectDecision(name, name != "RollingShutter", 9.0, 0.5, "fast")
        for name in ("RollingShutter", "MotionBlur", "Fog")
    )
    limited = limit_time_samples(MOVING, CAMERA, make_plan(2))
    explained = explain_limit(decisions, MOVING, limited)
    assert [one.reason for one in explained] == [
        "fast",
        "fast; 20 of 64 time samples, limited by the budget of a frame",
        "fast",
    ]
    assert explain_limit(decisions, limited, limited) is decisions
    assert explain_limit(decisions, CameraState(Pose.identity()), limited) is decisions
