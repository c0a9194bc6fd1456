"""Candidate tables: all candidates with bounds and times, of the renderers that can be measured."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.candidates import RendererCalibration, generate_calibration_plans
from catoptra_server.frames.plan.costs import CostCache, PlanTiming
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.renderers import RendererChoice, RendererPool
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.worlds import make_omni_camera, make_test_world

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


def test_costs_that_do_not_grow_are_measured_again_and_never_stored(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    times = iter((12.6, 12.6, 12.6))

    def measure(renderer: Any, kind: RendererKind, camera: Any, *others: Any) -> list[PlanTiming]:
        plans = generate_calibration_plans(kind, camera, others[0])
        ms = next(times)
        return [PlanTiming(plan, {"trace": ms}) for plan in plans]

    class Described:
        def describe(self) -> str:
            return "trace"

    pool = RendererPool(RendererChoice(Described(), TRACE, "test"))  # type: ignore[arg-type]
    cache = CostCache(tmp_path, build_scene(make_test_world()))
    RendererCalibration(pool, cache, measure).make_table(CAMERA, STATES)
    assert next(times, None) is None
    assert not list(tmp_path.iterdir())
    assert "not stored" in caplog.text


def test_second_measurement_that_grows_is_stored(tmp_path: Path) -> None:
    per_sample = iter((0.0, 2.0))

    def measure(renderer: Any, kind: RendererKind, camera: Any, *others: Any) -> list[PlanTiming]:
        plans = generate_calibration_plans(kind, camera, others[0])
        rate = next(per_sample)
        return [PlanTiming(plan, {"trace": 9.0 + rate * plan.samples**2}) for plan in plans]

    class Described:
        def describe(self) -> str:
            return "trace"

    pool = RendererPool(RendererChoice(Described(), TRACE, "test"))  # type: ignore[arg-type]
    cache = CostCache(tmp_path, build_scene(make_test_world()))
    RendererCalibration(pool, cache, measure).make_table(CAMERA, STATES)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("rates", [(12.6, 0.0, 0.0), (1.0, math.nan, 2.0), (0.0, math.inf, 1.0)])
def test_stored_costs_that_mean_nothing_are_measured_anew(
    tmp_path: Path, rates: tuple[float, ...]
) -> None:
    measured = []

    def measure(renderer: Any, kind: RendererKind, camera: Any, *others: Any) -> list[PlanTiming]:
        measured.append(kind)
        plans = generate_calibration_plans(kind, camera, others[0])
        return [PlanTiming(plan, {"trace": 2.0 * plan.samples**2}) for plan in plans]

    class Described:
        def describe(self) -> str:
            return "trace"

    pool = RendererPool(RendererChoice(Described(), TRACE, "test"))  # type: ignore[arg-type]
    cache = CostCache(tmp_path, build_scene(make_test_world()))
    key = cache.make_key("trace", CAMERA.camera, CAMERA.render_settings.surface)
    cache.write(key, {"trace": {"trace": rates}})
    RendererCalibration(pool, cache, measure).make_table(CAMERA, STATES)
    assert measured == [TRACE]
    RendererCalibration(pool, cache, measure).make_table(CAMERA, STATES)
    assert measured == [TRACE]
