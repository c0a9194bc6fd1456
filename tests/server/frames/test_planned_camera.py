"""Texts and numbers of a plan are formatted once."""

from __future__ import annotations

from dataclasses import replace

from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.frames.planned_camera import PlannedCamera
from catoptra_server.planning.budget_monitor import BudgetMonitor
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.error_bound import error_bound
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.perspective_plan import plan_perspective_view
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
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


def test_lens_has_no_bounds() -> None:
    plan = plan_perspective_view(2, kind=RendererKind.TRACE, reason="test")
    planned = PlannedCamera(PerspectiveCamera(20, 10, 1.0), plan, BudgetMonitor(0.0))
    assert (planned.plan_text, planned.bounds) == (str(plan), None)
