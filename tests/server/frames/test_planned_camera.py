"""Texts and numbers of a plan are formatted once."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from catoptra_protocol.optics.image_scale import compute_image_scale
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.frames.planned_camera import PlannedCamera
from catoptra_server.planning.budget_monitor import BudgetMonitor
from catoptra_server.planning.camera_spec import OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.planning.error_bound import error_bound
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.perspective_plan import plan_perspective_view
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import AccuracyTarget, RenderSettings
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=40)
SETTINGS = RenderSettings()


def choose(samples: int) -> PlanChoice:
    settings = replace(SETTINGS, samples=samples)
    plan = plan_from_settings(settings, CAMERA, kind=RendererKind.TRACE, reason="test")
    return PlanChoice(plan, error_bound(CAMERA, plan))


def test_text_and_bounds_follow_the_choice() -> None:
    first, second = choose(1), choose(3)
    spec = OmniCameraSpec(CAMERA, SETTINGS)
    planned = PlannedCamera(spec, first.plan, BudgetMonitor(0.0), first)
    assert planned.plan_text == str(first.plan)
    assert planned.view_key == (CAMERA, replace(first.plan, reason=""))
    planned.set_choice(second)
    assert planned.plan is second.plan
    assert planned.view_key == (CAMERA, replace(second.plan, reason=""))
    assert planned.plan_text == str(second.plan)
    assert second.bound is not None
    assert planned.bounds == second.bound.as_dict()


def test_frame_has_the_bound_of_its_plan_and_of_its_scene() -> None:
    choice = choose(2)
    assert choice.bound is not None
    planned = PlannedCamera(
        OmniCameraSpec(CAMERA, SETTINGS), choice.plan, BudgetMonitor(0.0), choice
    )
    for angle_rad in (1e-3, 4e-3):
        assert planned.bound_frame(angle_rad)
        assert not planned.bound_frame(angle_rad), "the same scene changes nothing"
        assert planned.bounds is not None
        scene_px = planned.bounds["scene_px"]
        assert scene_px == pytest.approx(angle_rad * compute_image_scale(CAMERA).max_px_per_rad)
        for name in ("max_px", "outline_px", "marker_px"):
            plan_px = choice.bound.as_dict()[name]
            assert planned.bounds[name] == pytest.approx(plan_px + scene_px)
        assert planned.bounds["max_deg"] >= math.degrees(angle_rad)


def test_target_that_the_scene_exceeds_is_not_met() -> None:
    choice = choose(3)
    assert choice.bound is not None
    target = AccuracyTarget(max_error_px=choice.bound.outline_error_px + 0.1)
    spec = OmniCameraSpec(CAMERA, replace(SETTINGS, accuracy_target=target))
    planned = PlannedCamera(spec, choice.plan, BudgetMonitor(0.0), choice)
    px_per_rad = compute_image_scale(CAMERA).max_px_per_rad
    for scene_px, is_met in ((0.05, True), (0.2, False), (0.01, True)):
        planned.bound_frame(scene_px / px_per_rad)
        assert planned.choice is not None
        assert planned.choice.target_met is is_met


def test_lens_has_no_bounds() -> None:
    plan = plan_perspective_view(2, kind=RendererKind.TRACE, reason="test")
    planned = PlannedCamera(
        PerspectiveCameraSpec(PerspectiveCamera(20, 10, 1.0)), plan, BudgetMonitor(0.0)
    )
    assert (planned.plan_text, planned.bounds) == (str(plan), None)
