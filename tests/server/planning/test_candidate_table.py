"""Candidate tables: all candidates with bounds and times, of the renderers that can be measured."""

from __future__ import annotations

from typing import Any

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.candidate_plans import generate_calibration_plans
from catoptra_server.planning.candidate_table import RendererCalibration
from catoptra_server.planning.cost_model import PlanTiming
from catoptra_server.planning.error_bound import error_bound
from catoptra_server.planning.renderer_choice import RendererChoice
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from helpers.worlds import make_omni_camera

TRACE = RendererKind.TRACE
CAMERA = OmniCameraSpec(make_omni_camera(width_px=64), RenderSettings())
STATES = (CameraState(Pose.identity()),)


def make_calibration(measure: Any) -> RendererCalibration:
    renderer: Any = object()
    return RendererCalibration(RendererPool(RendererChoice(renderer, TRACE, "test")), None, measure)


def test_options_have_the_bound_and_the_time_of_their_plan() -> None:
    def measure(renderer: Any, kind: RendererKind, camera: Any, *others: Any) -> list[PlanTiming]:
        plans = generate_calibration_plans(kind, camera, others[0])
        return [PlanTiming(plan, {"trace": 2.0 * plan.samples**2}) for plan in plans]

    table = make_calibration(measure).make_table(CAMERA, STATES)
    assert {option.plan.samples for option in table.options} == set(range(1, 9))
    for option in table.options:
        bound = error_bound(CAMERA.camera, option.plan)
        assert option.error_bound_px == bound.outline_error_px
        assert option.predicted_ms == pytest.approx(2.0 * option.plan.samples**2)


def test_table_without_a_renderer_that_can_be_measured_is_refused() -> None:
    def fail(*_: Any) -> list[PlanTiming]:
        raise RuntimeError("lost device")

    with pytest.raises(RendererUnavailableError, match="no renderer could be measured"):
        make_calibration(fail).make_table(CAMERA, STATES)
