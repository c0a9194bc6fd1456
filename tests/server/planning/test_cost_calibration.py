"""What is measured to know what frames cost, with a clock and views that are made up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.planning.cost_calibration import OTHER_STAGES, calibration_plans, measure_costs
from catoptra_server.planning.cost_model import cost_group, fit_cost_model
from catoptra_server.render.render_plan import PerPixel, RendererKind, RenderPlan
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.scene.mirror_mesh import Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=64)
TRACE = RendererKind.TRACE
HERE = (CameraState(Pose.identity()), CameraState(Pose.from_rpy((1.0, 0.0, 0.0))))


class _Lab:
    """A renderer whose frames take a millisecond a sample along a side, by its own clock."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.closed = 0
        self.exposures: list[CameraState] = []

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        lab = self

        class View:
            def draw(self, exposure: CameraState) -> RenderedImage:
                lab.exposures.append(exposure)
                lab.now_s += 1e-3 * (plan.samples + 0.5)
                stages = {"trace": float(plan.samples)}
                return RenderedImage(np.zeros((1, 1, 3), dtype=np.uint8), stages)

            def close(self) -> None:
                lab.closed += 1

        return View()

    def clock(self) -> float:
        return self.now_s


def test_calibration_when_done_has_medians_of_all_stages_and_of_what_is_between() -> None:
    lab = _Lab()
    found = measure_costs(lab, TRACE, CAMERA, PerPixel(), HERE, clock=lab.clock)  # type: ignore[arg-type]
    assert [one.plan.samples for one in found] == [1, 2, 1]
    assert [one.stage_ms["trace"] for one in found] == [1.0, 2.0, 1.0]
    assert all(one.stage_ms[OTHER_STAGES] == pytest.approx(0.5) for one in found)
    assert lab.closed == 3
    assert set(lab.exposures) == set(HERE)


@pytest.mark.parametrize("kind", RendererKind)
def test_calibration_when_all_is_open_covers_every_way_that_it_can_go(kind: RendererKind) -> None:
    plans = list(calibration_plans(kind, CAMERA, PerPixel()))
    assert len({cost_group(plan) for plan in plans}) == (2 if kind is TRACE else 1)
    assert len({plan.samples for plan in plans}) > 1


def test_calibration_of_polygons_never_leaves_rays_out() -> None:
    plans = calibration_plans(TRACE, CAMERA, Tessellation(8, 8))
    assert {plan.stride_px for plan in plans} == {1}


def test_calibration_when_fitted_gives_its_own_times_back() -> None:
    lab = _Lab()
    found = measure_costs(lab, TRACE, CAMERA, PerPixel(), HERE, clock=lab.clock)  # type: ignore[arg-type]
    model = fit_cost_model(CAMERA, found)
    assert model.predict_frame_ms(found[1].plan) == pytest.approx(2.5)
