"""Trials of the other renderer, with a clock and renderers that take invented times."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.frames.renderer_trial import MAX_SHARE, NUM_ROUNDS, NUM_WARM_UP_ROUNDS
from catoptra_server.frames.view_cache import ViewCache
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.effect_rates import RenderEngine
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import RendererChoice
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.planning.renderer_preferences import WINDOW_FRAMES
from catoptra_server.planning.renderer_rule import RendererRule, SceneLoad
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import World
from helpers.worlds import make_omni_camera

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
CAMERA = OmniCameraSpec(make_omni_camera(width_px=16), RenderSettings(samples=1))
STATE = CameraState(Pose.identity())
RULE = RendererRule(
    SceneLoad(100, has_textures=False, num_point_lights=0),
    {TRACE: RenderEngine.KERNEL, RASTER: RenderEngine.SOFTWARE_OPENGL},
)
NUM_STEPS = 2 * (NUM_ROUNDS + NUM_WARM_UP_ROUNDS)
EMPTY_WORLD = build_scene(World("empty", ())), World("empty", ())
# So slow that any other renderer is worth a trial.
TRACE_S = 0.5


class Machine:
    """Renderers by a clock of their own; logs frames and ends."""

    def __init__(self, raster_s: float) -> None:
        self.now_s = 0.0
        self.log: list[str] = []
        self.frame_s = {TRACE: TRACE_S, RASTER: raster_s}
        self.failing: RendererKind | None = None

    def make_views(self, rule: RendererRule | None = RULE) -> ViewCache:
        """Views of this machine's renderers, trace first."""
        create = partial(self._create, RASTER)
        choice = RendererChoice(
            self._create(TRACE), TRACE, "rule", {RASTER: create}, partial(self._create, TRACE), rule
        )
        summarizer = SceneSummarizer(*EMPTY_WORLD)
        return ViewCache(RenderPlanner(RendererPool(choice)), summarizer, clock=lambda: self.now_s)

    def _create(self, kind: RendererKind) -> Any:
        machine = self

        class FakeView:
            memory_bytes = 1

            def render(self, camera_state: CameraState, *_effects: object) -> RenderedImage:
                machine.log.append(kind.value)
                machine.now_s += machine.frame_s[kind]
                if machine.failing is kind:
                    raise RuntimeError("lost device")
                return RenderedImage(np.zeros((16, 16, 3), dtype=np.uint8), {})

            def close(self) -> None:
                machine.log.append(f"close view of {kind.value}")

        class FakeRenderer:
            def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
                return FakeView()

            def describe(self) -> str:
                return "fake"

            def close(self) -> None:
                machine.log.append(f"close {kind.value}")

        return FakeRenderer()


def draw(views: ViewCache, frames: int = WINDOW_FRAMES) -> str:
    """Draw frames for a client; the plan of the last one."""
    rendered = [views.render(ViewRequest(CAMERA, STATE)) for _ in range(frames)]
    return rendered[-1].plan


def finish_trial(views: ViewCache) -> int:
    """Number of steps of a trial in a pause."""
    steps = 0
    while views.work_beside_frames(is_idle=True):
        steps += 1
        assert steps < 100, "the trial does not end"
    return steps


def test_trial_in_a_pause_draws_both_in_turn_and_changes_to_the_faster() -> None:
    machine = Machine(raster_s=0.1)
    views = machine.make_views()
    assert draw(views).startswith("trace")
    machine.log.clear()
    assert finish_trial(views) == NUM_STEPS - 1
    assert machine.log == ["raster", "trace"] * (NUM_STEPS // 2)
    plan = draw(views, 1)
    assert plan.startswith("raster")
    assert "raster 100.0 ms, trace 500.0 ms a frame, measured in turn on this machine" in plan


def test_trial_that_the_other_loses_changes_nothing_and_frees_the_other() -> None:
    machine = Machine(raster_s=0.45)
    views = machine.make_views()
    draw(views)
    finish_trial(views)
    assert machine.log[-2:] == ["close view of raster", "close raster"]
    assert draw(views, 1).startswith("trace")
    assert not views.work_beside_frames(is_idle=True)


def test_trial_beside_frames_takes_a_small_share_of_the_time() -> None:
    machine = Machine(raster_s=0.3)
    views = machine.make_views()
    draw(views)
    begin_s, spent_s, drawn = machine.now_s, 0.0, 0
    while views.work_beside_frames(is_idle=False):
        draw(views, 1)
        drawn += 1
        trial_s = machine.now_s - begin_s - TRACE_S * drawn
        assert trial_s <= MAX_SHARE * (machine.now_s - begin_s)
        assert drawn < 10_000, "the trial does not end"
        spent_s = trial_s
    assert spent_s > 0.0
    assert draw(views, 1).startswith("raster")


def test_first_frames_are_not_delayed_by_a_trial() -> None:
    machine = Machine(raster_s=0.1)
    views = machine.make_views()
    draw(views, WINDOW_FRAMES - 1)
    assert not views.work_beside_frames(is_idle=True)
    assert "raster" not in machine.log


def test_final_choice_has_no_trial() -> None:
    machine = Machine(raster_s=0.1)
    views = machine.make_views(rule=None)
    draw(views)
    assert not views.work_beside_frames(is_idle=True)


@pytest.mark.parametrize("failing", RendererKind)
def test_fault_in_a_trial_ends_it_for_good(
    failing: RendererKind, caplog: pytest.LogCaptureFixture
) -> None:
    machine = Machine(raster_s=0.1)
    views = machine.make_views()
    draw(views)
    machine.failing = failing
    finish_trial(views)
    machine.failing = None
    assert f"{failing.value} failed in a trial" in caplog.text
    assert draw(views).startswith("trace")
    assert not views.work_beside_frames(is_idle=True)
