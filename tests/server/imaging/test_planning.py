"""Numbers are taken as they are; a dial has every renderer measured, once, and times correct it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.imaging.planning import Planning
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.plan.cost_model import Measured
from catoptra_server.plan.render_plan import RendererKind
from catoptra_server.render.calibration import plans_to_measure
from catoptra_server.render.choice import Choice
from catoptra_server.render.cost_cache import CostCache
from catoptra_server.render.renderer import Exposure, Renderer
from catoptra_server.robot.render_wish import Dial, RenderWish, Surface
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.mirror_mesh import PolygonSplit
from helpers.worlds import omni_camera, room

CAMERA = omni_camera(width_px=100)
HERE = (Exposure(Pose.identity()),)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
MS_A_SAMPLE = {TRACE: 5.0, RASTER: 1.0}


class _Renderer:
    """Something that can be described and closed."""

    def __init__(self, name: str) -> None:
        self.name, self.closed = name, False

    def describe(self) -> str:
        return self.name

    def close(self) -> None:
        self.closed = True


class Laboratory:
    """Measures nothing: a frame takes so many ms for each sample of a pixel."""

    def __init__(self) -> None:
        self.measured: list[RendererKind] = []
        self.made: list[Any] = []

    def __call__(
        self,
        renderer: Renderer,
        kind: RendererKind,
        camera: OmniCamera,
        surface: Surface,
        exposures: Sequence[Exposure],
    ) -> list[Measured]:
        self.measured.append(kind)
        plans = plans_to_measure(kind, camera, surface)
        return [Measured(p, {"all": MS_A_SAMPLE[kind] * p.samples**2}) for p in plans]

    def make_raster(self) -> Any:
        self.made.append(_Renderer("raster"))
        return self.made[-1]

    def planning(self, cache: CostCache | None = None) -> Planning:
        renderer: Any = _Renderer("trace")
        choice = Choice(renderer, TRACE, "test", {RASTER: self.make_raster})
        return Planning(choice, cache, measure=self)


def eye(dial: Dial = Dial(), **numbers: Any) -> OmniEye:  # noqa: B008 - frozen
    return OmniEye(CAMERA, RenderWish(dial=dial, **numbers))


def test_eye_when_no_dial_is_turned_follows_its_numbers_and_nothing_is_measured() -> None:
    lab = Laboratory()
    choice = lab.planning().choose(eye(samples=3), HERE)
    assert (choice.plan.samples, choice.plan.renderer, choice.plan.reason) == (3, TRACE, "test")
    assert choice.bound is not None
    assert (choice.ms, choice.better, lab.measured, lab.made) == (None, None, [], [])


def test_eye_when_a_dial_is_turned_has_every_renderer_measured_once() -> None:
    lab = Laboratory()
    planning = lab.planning()
    coarse, fine = (planning.choose(eye(Dial(px)), HERE) for px in (2.0, 0.1))
    assert lab.measured == [TRACE, RASTER]
    assert coarse.plan.renderer is RASTER
    assert (fine.plan.renderer, fine.plan.samples, fine.ms) == (TRACE, 8, pytest.approx(320.0))


def test_numbers_when_a_dial_is_turned_do_not_count() -> None:
    choice = Laboratory().planning().choose(eye(Dial(0.1), samples=3, stride_px=7), HERE)
    assert choice.plan.samples == 8
    assert choice.plan.stride_px != 7


def test_renderer_when_it_cannot_be_made_is_no_choice() -> None:
    class Absent(Laboratory):
        def make_raster(self) -> Any:
            raise RendererUnavailableError("no OpenGL", "install it")

    lab = Absent()
    assert lab.planning().choose(eye(Dial(2.0)), HERE).plan.renderer is TRACE
    assert lab.measured == [TRACE]


def test_costs_when_kept_on_disk_are_not_measured_again(tmp_path: Path) -> None:
    cache = CostCache(tmp_path, build_scene(room()))
    first, second = Laboratory(), Laboratory()
    chosen = [lab.planning(cache).choose(eye(Dial(0.4)), HERE) for lab in (first, second)]
    assert (first.measured, second.measured) == ([TRACE, RASTER], [])
    assert chosen[0].plan == chosen[1].plan


def test_prediction_when_frames_take_twice_as_long_doubles_for_that_renderer() -> None:
    planning = Laboratory().planning()
    asked = eye(Dial(0.1))
    plan = planning.choose(asked, HERE).plan
    assert (plan.renderer, plan.samples) == (TRACE, 8)
    assert planning.predicted_ms(asked, plan) == pytest.approx(320.0)
    planning.correct(asked, plan, 640.0)
    assert planning.predicted_ms(asked, plan) == pytest.approx(640.0)
    assert planning.factor(RASTER) == 1.0
    assert planning.predicted_ms(OmniEye(omni_camera(width_px=99), RenderWish()), plan) is None


def test_dial_when_errors_have_no_bound_is_answered_by_numbers_and_says_so() -> None:
    camera = omni_camera(mirror=ParabolicMirror(0.03))
    wish = RenderWish(PolygonSplit(8, 8), dial=Dial(0.5))
    choice = Laboratory().planning().choose(OmniEye(camera, wish), HERE)
    assert (choice.bound, choice.keeps_word) == (None, False)
    assert "no bound" in choice.plan.reason


def test_planning_when_closed_closes_all_that_it_made() -> None:
    lab = Laboratory()
    planning = lab.planning()
    planning.choose(eye(Dial(2.0)), HERE)
    planning.close()
    assert [renderer.closed for renderer in lab.made] == [True]
