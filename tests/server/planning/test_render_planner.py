"""Numbers are taken as they are; a dial has every renderer measured, once, and times correct it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.candidate_plans import generate_calibration_plans
from catoptra_server.planning.cost_cache import CostCache
from catoptra_server.planning.cost_model import PlanTiming
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import RendererChoice
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import AccuracyTarget, MirrorSurface, RenderSettings
from catoptra_server.scene.mirror_mesh import Tessellation
from catoptra_server.scene.scene_mesh import build_scene
from helpers.worlds import make_omni_camera, make_test_world

CAMERA = make_omni_camera(width_px=100)
CAMERA_STATES = (CameraState(Pose.identity()),)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
MS_PER_SAMPLE = {TRACE: 5.0, RASTER: 1.0}


class _NamedRenderer:
    """Something that can be described and closed."""

    def __init__(self, name: str) -> None:
        self.name, self.closed = name, False

    def describe(self) -> str:
        return self.name

    def close(self) -> None:
        self.closed = True


class FakeCostMeasurement:
    """Measures nothing: a frame takes so many ms for each sample of a pixel."""

    def __init__(self) -> None:
        self.measured_kinds: list[RendererKind] = []
        self.created: list[Any] = []

    def __call__(
        self,
        renderer: Renderer,
        kind: RendererKind,
        camera: OmniCamera,
        surface: MirrorSurface,
        exposures: Sequence[CameraState],
    ) -> list[PlanTiming]:
        self.measured_kinds.append(kind)
        plans = generate_calibration_plans(kind, camera, surface)
        return [PlanTiming(p, {"all": MS_PER_SAMPLE[kind] * p.samples**2}) for p in plans]

    def create_raster(self) -> Any:
        self.created.append(_NamedRenderer("raster"))
        return self.created[-1]

    def create_planner(self, cache: CostCache | None = None) -> RenderPlanner:
        renderer: Any = _NamedRenderer("trace")
        choice = RendererChoice(renderer, TRACE, "test", {RASTER: self.create_raster})
        return RenderPlanner(choice, cache, measure=self)


def camera_spec(target: AccuracyTarget = AccuracyTarget(), **numbers: Any) -> OmniCameraSpec:  # noqa: B008 - frozen
    return OmniCameraSpec(CAMERA, RenderSettings(accuracy_target=target, **numbers))


def test_eye_when_no_dial_is_turned_follows_its_numbers_and_nothing_is_measured() -> None:
    lab = FakeCostMeasurement()
    choice = lab.create_planner().choose_plan(camera_spec(samples=3), CAMERA_STATES)
    assert (choice.plan.samples, choice.plan.renderer, choice.plan.reason) == (3, TRACE, "test")
    assert choice.bound is not None
    assert (choice.predicted_ms, choice.more_accurate, lab.measured_kinds, lab.created) == (
        None,
        None,
        [],
        [],
    )


def test_eye_when_a_dial_is_turned_has_every_renderer_measured_once() -> None:
    lab = FakeCostMeasurement()
    planning = lab.create_planner()
    coarse, fine = (
        planning.choose_plan(camera_spec(AccuracyTarget(px)), CAMERA_STATES) for px in (2.0, 0.1)
    )
    assert lab.measured_kinds == [TRACE, RASTER]
    assert coarse.plan.renderer is RASTER
    assert (fine.plan.renderer, fine.plan.samples, fine.predicted_ms) == (
        TRACE,
        8,
        pytest.approx(320.0),
    )


def test_numbers_when_a_dial_is_turned_do_not_count() -> None:
    choice = (
        FakeCostMeasurement()
        .create_planner()
        .choose_plan(camera_spec(AccuracyTarget(0.1), samples=3, stride_px=7), CAMERA_STATES)
    )
    assert choice.plan.samples == 8
    assert choice.plan.stride_px != 7


def test_renderer_when_it_cannot_be_made_is_no_choice() -> None:
    class Absent(FakeCostMeasurement):
        def create_raster(self) -> Any:
            raise RendererUnavailableError("no OpenGL", "install it")

    lab = Absent()
    assert (
        lab.create_planner()
        .choose_plan(camera_spec(AccuracyTarget(2.0)), CAMERA_STATES)
        .plan.renderer
        is TRACE
    )
    assert lab.measured_kinds == [TRACE]


def test_costs_when_kept_on_disk_are_not_measured_again(tmp_path: Path) -> None:
    cache = CostCache(tmp_path, build_scene(make_test_world()))
    first, second = FakeCostMeasurement(), FakeCostMeasurement()
    chosen = [
        lab.create_planner(cache).choose_plan(camera_spec(AccuracyTarget(0.4)), CAMERA_STATES)
        for lab in (first, second)
    ]
    assert (first.measured_kinds, second.measured_kinds) == ([TRACE, RASTER], [])
    assert chosen[0].plan == chosen[1].plan


def test_prediction_when_frames_take_twice_as_long_doubles_for_that_renderer() -> None:
    planning = FakeCostMeasurement().create_planner()
    asked = camera_spec(AccuracyTarget(0.1))
    plan = planning.choose_plan(asked, CAMERA_STATES).plan
    assert (plan.renderer, plan.samples) == (TRACE, 8)
    assert planning.predict_frame_ms(asked, plan) == pytest.approx(320.0)
    planning.update_correction(asked, plan, 640.0)
    assert planning.predict_frame_ms(asked, plan) == pytest.approx(640.0)
    assert planning.cost_correction(RASTER) == 1.0
    assert (
        planning.predict_frame_ms(
            OmniCameraSpec(make_omni_camera(width_px=99), RenderSettings()), plan
        )
        is None
    )


def test_dial_when_errors_have_no_bound_is_answered_by_numbers_and_says_so() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03))
    wish = RenderSettings(Tessellation(8, 8), accuracy_target=AccuracyTarget(0.5))
    choice = (
        FakeCostMeasurement()
        .create_planner()
        .choose_plan(OmniCameraSpec(camera, wish), CAMERA_STATES)
    )
    assert (choice.bound, choice.target_met) == (None, False)
    assert "no bound" in choice.plan.reason


def test_planning_when_closed_closes_all_that_it_made() -> None:
    lab = FakeCostMeasurement()
    planning = lab.create_planner()
    planning.choose_plan(camera_spec(AccuracyTarget(2.0)), CAMERA_STATES)
    planning.close()
    assert [renderer.closed for renderer in lab.created] == [True]
