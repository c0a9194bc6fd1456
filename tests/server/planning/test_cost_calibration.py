"""Times of the calibration plans, with a fake clock and fake views."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.candidates import OTHER_STAGES, measure_costs
from catoptra_server.frames.plan.costs import fit_cost_model
from catoptra_server.render.render_settings import PerPixel
from catoptra_server.render.renderer import RenderedImage, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=64)
TRACE = RendererKind.TRACE
STATES = (CameraState(Pose.identity()), CameraState(Pose.from_rpy((1.0, 0.0, 0.0))))


class _FakeRenderer:
    """A renderer whose frames take a millisecond a sample of a pixel, by a clock of its own."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.num_closed = 0
        self.camera_states: list[CameraState] = []

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        renderer = self

        class FakeView:
            def render(self, camera_state: CameraState) -> RenderedImage:
                renderer.camera_states.append(camera_state)
                renderer.now_s += 1e-3 * (plan.samples**2 + 0.5)
                stages = {"trace": float(plan.samples**2)}
                return RenderedImage(np.zeros((1, 1, 3), dtype=np.uint8), stages)

            def close(self) -> None:
                renderer.num_closed += 1

        return FakeView()

    def clock(self) -> float:
        return self.now_s


def test_calibration_has_medians_of_all_stages_and_of_the_time_between() -> None:
    renderer = _FakeRenderer()
    found = measure_costs(renderer, TRACE, CAMERA, PerPixel(), STATES, clock=renderer.clock)  # type: ignore[arg-type]
    assert [one.plan.samples for one in found] == [1, 2, 5]
    assert [one.stage_ms["trace"] for one in found] == [1.0, 4.0, 25.0]
    assert all(one.stage_ms[OTHER_STAGES] == pytest.approx(0.5) for one in found)
    assert renderer.num_closed == 3
    assert set(renderer.camera_states) == set(STATES)


def test_calibration_when_fitted_reproduces_the_measured_times() -> None:
    renderer = _FakeRenderer()
    found = measure_costs(renderer, TRACE, CAMERA, PerPixel(), STATES, clock=renderer.clock)  # type: ignore[arg-type]
    model = fit_cost_model(CAMERA, found)
    assert model.predict_frame_ms(found[1].plan) == pytest.approx(4.5)
