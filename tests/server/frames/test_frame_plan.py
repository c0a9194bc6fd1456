"""Plans of cameras: chosen once, published with their bounds, and chosen again by frame times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import compute_image_scale
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import EffectChange, Threshold
from catoptra_server.effects.bounds.coordinate_rounding import CoordinateErrors
from catoptra_server.effects.effect_plan import EffectPlan
from catoptra_server.frames.frame_plan import CameraPlan, ErrorBoundTable, FramePlanner
from catoptra_server.frames.plan.camera import OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.error_bound import SceneDisplacement, error_bound
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.plans import PerspectivePlan, PlanChoice, plan_from_settings
from catoptra_server.render.renderer import AccuracyTarget, RenderedImage, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.objects import CameraState, Shutter
from catoptra_server.world.scene_mesh import build_scene
from helpers.invented_costs import make_pool, measure_per_sample
from helpers.mirror_checks import make_camera
from helpers.robots import CAMERA
from helpers.worlds import make_omni_camera, make_test_world

CAMERA_STATE = CameraState(Pose.identity())
NO_PIXELS = np.zeros((1, 1, 3), dtype=np.uint8)


class FakeScene:
    """A scene with nothing near a mirror, whose coordinates displace as a test says."""

    def __init__(self) -> None:
        self.scene = build_scene(make_test_world())
        self.angle_rad = 1e-6
        self.nearest_m = 1e3

    def min_distance_m(self, camera_state: CameraState, *, has_ego_body: bool) -> float:
        return self.nearest_m

    def max_rounding_angle_rad(self, camera_state: CameraState, errors: CoordinateErrors) -> float:
        return self.angle_rad


def make_plans(
    published: ErrorBoundTable | None = None, scene: FakeScene | None = None
) -> FramePlanner:
    """Plans by a renderer that was measured at 1 ms a sample."""
    planner = RenderPlanner(make_pool(), measure=measure_per_sample())
    summarizer: Any = scene or FakeScene()
    # The clock stands still: a frame takes the time of its drawing.
    return FramePlanner(planner, summarizer, error_bounds=published, clock=lambda: 0.0)


def make_spec(budget_ms: float = 0.0, max_error_px: float = 0.0) -> OmniCameraSpec:
    target = AccuracyTarget(budget_ms=budget_ms, max_error_px=max_error_px)
    return OmniCameraSpec(CAMERA.camera, replace(CAMERA.render_settings, accuracy_target=target))


BUDGETED = make_spec(10.0)


def draw_frames(
    plans: FramePlanner, ms_per_sample: float, frames: int, spec: OmniCameraSpec = BUDGETED
) -> list[int]:
    """Samples of the plans of some frames, one entry a change."""
    samples: list[int] = []
    for _ in range(frames):
        frame_plan = plans.decide(spec, CAMERA_STATE)
        samples.append(frame_plan.plan.samples)
        ms = ms_per_sample * frame_plan.plan.samples**2
        plans.record(frame_plan, RenderedImage(NO_PIXELS, {"trace": ms}), ms)
    return [number for number, _ in groupby(samples)]


# At 10 ms a plan of 3 x 3 samples was chosen, predicted at 9 ms; one of 4 x 4 would take 16. A
# second at 30 Hz decides, ten seconds of headroom try a more accurate plan.
WINDOW_FRAMES, HYSTERESIS_FRAMES = 30, 300


@pytest.mark.parametrize(
    ("ms_per_sample", "frames", "samples"),
    [
        (1.0, 1000, [3]),
        (1.32, 1000, [3]),  # 11.9 ms: within a fifth
        (1.35, WINDOW_FRAMES, [3]),
        (1.35, WINDOW_FRAMES + 1, [3, 2]),  # 12.2 ms
        (50.0, 1000, [3, 1]),
        (0.5, WINDOW_FRAMES + HYSTERESIS_FRAMES, [3]),
        (0.5, WINDOW_FRAMES + HYSTERESIS_FRAMES + 1, [3, 4]),  # 8 ms
        (0.54, 2000, [3]),  # 4 x 4 samples take 8.6 ms, which nearly fills the budget
    ],
)
def test_plan_follows_the_budget(ms_per_sample: float, frames: int, samples: list[int]) -> None:
    assert draw_frames(make_plans(), ms_per_sample, frames) == samples


def test_few_slow_frames_change_no_plan() -> None:
    plans = make_plans()
    assert draw_frames(plans, 1.0, 20) == draw_frames(plans, 5.0, 14) == [3]


def test_budget_when_exceeded_replans_and_logs_why(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        assert draw_frames(make_plans(), 2.0, 1000) == [3, 2]
    assert "18.0 ms a frame (median), budget 10 ms: too slow" in caplog.text


def test_budget_when_unreachable_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        draw_frames(make_plans(), 50.0, 1000)
    assert caplog.text.count("no better plan") == 1


def test_budget_when_frames_become_fast_again_is_used_fully() -> None:
    plans = make_plans()
    assert draw_frames(plans, 2.0, 100) == [3, 2]
    assert draw_frames(plans, 0.9, 1000) == [2, 3]


def test_wait_for_headroom_doubles_after_a_mistake() -> None:
    plans = make_plans()
    assert draw_frames(plans, 0.5, WINDOW_FRAMES + HYSTERESIS_FRAMES + 1) == [3, 4]
    # The new plan turns out too slow.
    assert draw_frames(plans, 1.0, WINDOW_FRAMES + 1) == [4, 3]
    assert draw_frames(plans, 0.5, 2 * HYSTERESIS_FRAMES) == [3]
    assert draw_frames(plans, 0.5, WINDOW_FRAMES) == [3, 4]


def test_stages_that_no_calibration_has_are_added_to_what_others_are_predicted_to_take() -> None:
    plans, spec = make_plans(), make_spec(15.0)
    for _ in range(WINDOW_FRAMES):
        frame_plan = plans.decide(spec, CAMERA_STATE)
        plans.record(frame_plan, RenderedImage(NO_PIXELS, {"trace": 9.0, "effects": 2.0}), 11.0)
    faster = plans.find_state(spec, CAMERA_STATE).choice.faster
    assert faster is not None
    assert faster.predicted_ms == pytest.approx(4.0 + 2.0)


@pytest.mark.parametrize("spec", [make_spec(), BUDGETED])
def test_plan_without_a_reason_to_change_is_kept(spec: OmniCameraSpec) -> None:
    plans = make_plans()
    draw_frames(plans, 1.0, 40, spec)
    first, second = (plans.decide(spec, CAMERA_STATE) for _ in range(2))
    assert second.plan is first.plan
    assert second.plan_text is first.plan_text
    assert second.view_key is first.view_key


def test_state_when_requested_adds_no_camera() -> None:
    published = ErrorBoundTable()
    plans = make_plans(published)
    state = plans.find_state(BUDGETED, CAMERA_STATE)
    assert (state.choice.plan.samples, state.median_ms) == (3, None)
    assert published.get(BUDGETED) is None
    draw_frames(plans, 1.0, 30)
    assert plans.find_state(BUDGETED, CAMERA_STATE).median_ms == pytest.approx(9.0)


def test_state_predicts_what_drawn_frames_took() -> None:
    plans, spec = make_plans(), make_spec(15.0)
    assert plans.find_state(spec, CAMERA_STATE).choice.predicted_ms == pytest.approx(9.0)
    draw_frames(plans, 1.5, 30, spec)
    state = plans.find_state(spec, CAMERA_STATE)
    assert state.choice.predicted_ms == pytest.approx(state.median_ms) == pytest.approx(13.5)
    assert state.choice.faster is not None
    assert state.choice.faster.predicted_ms == pytest.approx(6.0)


def known_bounds(published: ErrorBoundTable, specs: Sequence[OmniCameraSpec]) -> list[bool]:
    return [published.get(spec) is not None for spec in specs]


def test_cameras_when_forgotten_are_planned_anew_and_have_no_published_bound() -> None:
    published = ErrorBoundTable()
    plans, specs = make_plans(published), (BUDGETED, make_spec(20.0))
    planned = [plans.plan_camera(spec) for spec in specs]
    assert known_bounds(published, specs) == [False, False], "no frame was requested"
    frames = [plans.decide(spec, CAMERA_STATE) for spec in specs]
    assert known_bounds(published, specs) == [True, True]
    assert [published[one.requested].numbers_by_name() for one in frames] == [
        one.bounds for one in frames
    ]
    plans.forget_all()
    assert known_bounds(published, specs) == [False, False]
    assert plans.plan_camera(specs[0]) is not planned[0]


def test_cameras_are_limited_and_so_are_published_bounds() -> None:
    published = ErrorBoundTable()
    plans = make_plans(published)
    specs = [make_spec(max_error_px=1.0 + 0.001 * n) for n in range(300)]
    for spec in specs:
        plans.decide(spec, CAMERA_STATE)
    assert known_bounds(published, specs) == 44 * [False] + 256 * [True]


def test_perspective_camera_has_the_plan_of_the_preferred_renderer() -> None:
    planned = make_plans().plan_camera(PerspectiveCameraSpec(PerspectiveCamera(20, 10, 1.0)))
    assert (planned.plan.renderer, planned.plan.samples) == (RendererKind.TRACE, 2)
    assert (planned.choice, planned.bounds) == (None, None)


SMALL = make_omni_camera(width_px=40)
SETTINGS = RenderSettings()
NO_TARGET = AccuracyTarget()


TRACE = RendererKind.TRACE
PX_PER_RAD = compute_image_scale(SMALL).max_px_per_rad


def choose(samples: int, target: AccuracyTarget = NO_TARGET) -> PlanChoice:
    settings = replace(SETTINGS, samples=samples)
    plan = plan_from_settings(settings, SMALL, kind=TRACE, reason="test")
    return PlanChoice(plan, error_bound(SMALL, plan), target=target)


def test_text_and_bounds_follow_the_choice() -> None:
    first, second = choose(1), choose(3)
    spec = OmniCameraSpec(SMALL, SETTINGS)
    planned = CameraPlan(spec, first.plan, first)
    assert planned.plan_text == str(first.plan)
    assert planned.view_key == (SMALL, replace(first.plan, reason=""))
    planned.set_choice(second)
    assert planned.plan is second.plan
    assert planned.view_key == (SMALL, replace(second.plan, reason=""))
    assert planned.plan_text == str(second.plan)
    assert planned.bounds is None, "no frame was placed"
    planned.bound_frame({TRACE: SceneDisplacement(0.0)})
    assert second.bound is not None
    assert planned.bounds == second.bound.numbers_by_name() | {"scene_px": 0.0}


def test_frame_has_the_bound_of_its_plan_and_of_its_scene() -> None:
    choice = choose(2)
    assert choice.bound is not None
    planned = CameraPlan(OmniCameraSpec(SMALL, SETTINGS), choice.plan, choice)
    for angle_rad in (1e-3, 4e-3):
        planned.bound_frame({TRACE: SceneDisplacement(angle_rad)})
        bounds = planned.bounds
        planned.bound_frame({TRACE: SceneDisplacement(angle_rad)})
        assert planned.bounds is bounds is not None, "the same scene changes nothing"
        scene_px = planned.bounds["scene_px"]
        assert scene_px == pytest.approx(angle_rad * PX_PER_RAD)
        for name in ("max_px", "outline_px", "marker_px"):
            plan_px = choice.bound.numbers_by_name()[name]
            assert planned.bounds[name] == pytest.approx(plan_px + scene_px)
        assert planned.bounds["max_deg"] >= math.degrees(angle_rad)


def test_target_that_the_scene_exceeds_is_not_met_and_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bound = choose(3).bound
    assert bound is not None
    choice = choose(3, AccuracyTarget(max_error_px=bound.outline_error_px + 0.3))
    planned = CameraPlan(OmniCameraSpec(SMALL, SETTINGS), choice.plan, choice)
    for scene_px, is_met in ((0.05, True), (0.35, False), (0.01, True), (0.4, False)):
        planned.bound_frame({TRACE: SceneDisplacement(scene_px / PX_PER_RAD)})
        assert planned.choice is not None
        assert planned.choice.target_met is is_met
        assert ("is not met" in planned.plan_text) is not is_met
    assert [record.getMessage() for record in caplog.records] == [
        "accuracy target of 40 x 40 px: 0.535706 px is not met: scene 0.35 of 0.586 px "
        "(float32 coordinates of near or large triangles: smaller ones or distance would help)"
    ]


def test_plan_is_chosen_with_the_part_of_the_scene() -> None:
    scene = FakeScene()
    spec = make_spec(max_error_px=0.3)
    samples = []
    for scene_px in (0.001, 0.1):
        scene.angle_rad = scene_px / compute_image_scale(spec.camera).max_px_per_rad
        plans = make_plans(scene=scene)
        asked = plans.find_state(spec, CAMERA_STATE).choice
        frame_plan = plans.decide(spec, CAMERA_STATE)
        assert frame_plan.choice is not None
        assert frame_plan.choice.target_met
        # One number in the reply about the plan, in the frame, and in what is logged.
        assert (str(asked), asked.bound) == (str(frame_plan.choice), frame_plan.choice.bound)
        assert frame_plan.bounds == frame_plan.choice.bound.numbers_by_name()
        assert frame_plan.bounds["scene_px"] == pytest.approx(scene_px)
        assert frame_plan.plan_text == asked.text
        samples.append(frame_plan.plan.samples)
    assert samples == [3, 4]


def test_bound_of_one_viewpoint_follows_the_distance_of_the_nearest_thing() -> None:
    scene = FakeScene()
    plans = make_plans(scene=scene)
    spec = replace(AUTO, camera=replace(AUTO.camera, is_approximated=True))
    scene_px = []
    for scene.nearest_m in (1e3, 1.0, 0.5, math.inf):
        bounds = plans.decide(spec, CAMERA_STATE).bounds
        assert bounds is not None
        scene_px.append(bounds["scene_px"])
    far_px, near_px, nearest_px, beyond_px = scene_px
    assert beyond_px < far_px < 2e-3 * near_px
    assert nearest_px == pytest.approx(2.0 * near_px, rel=0.05)


def test_neighbours_of_a_plan_have_the_bound_of_the_frame_s_place() -> None:
    scene = FakeScene()
    plans, spec = make_plans(scene=scene), make_spec(max_error_px=0.3)
    for scene.angle_rad in (1e-6, 1e-3, 1e-5):
        choice = plans.decide(spec, CAMERA_STATE).choice
        assert choice is not None
        assert choice.bound is not None
        assert choice.more_accurate is not None
        assert choice.faster is not None
        scene_px = choice.bound.numbers_by_name()["scene_px"]
        assert choice.more_accurate.scene_px == choice.faster.scene_px == scene_px
        assert (
            choice.more_accurate.error_bound_px
            < choice.bound.outline_error_px
            < choice.faster.error_bound_px
        )


@pytest.mark.parametrize(
    ("change", "later_s", "x_m", "shutter", "is_held"),
    [
        (8.1, 0.5, 0.3, None, True),
        (8.0, 0.5, 0.3, None, False),
        (8.1, 0.6, 0.3, None, False),
        (8.1, 0.5, 0.4, None, False),
        (8.1, 0.5, 0.3, Shutter(0.01, 0.0, 0.0), False),
    ],
)
def test_change_that_is_large_is_held_for_a_moment_near_its_place(
    change: float, later_s: float, x_m: float, shutter: Shutter | None, is_held: bool
) -> None:
    spec = make_spec()
    plan = CameraPlan(spec, choose(2).plan)
    effects = EffectPlan(thresholds={"Shadows": Threshold(1.0), "Vignetting": Threshold(1.0)})
    state = CameraState(Pose.identity())
    measured = {"Shadows": EffectChange(change), "Vignetting": EffectChange(2.0)}
    assert plan.hold_changes(effects, state, 3.0) is effects
    assert plan.add_held(effects, state, measured, 3.0) == measured
    moved = replace(state, world_from_mirror=Pose(np.eye(3), np.array((x_m, 0.0, 0.0))))
    held = plan.hold_changes(effects, replace(moved, shutter=shutter), 3.0 + later_s)
    assert [one.is_known for one in held.thresholds.values()] == [is_held, False]
    if is_held:
        changes = plan.add_held(held, moved, {"Vignetting": EffectChange(2.1)}, 3.0 + later_s)
        assert changes["Shadows"] == EffectChange(change, is_earlier=True)
        assert changes["Vignetting"] == EffectChange(2.1)


def test_lens_has_no_bounds() -> None:
    plan = PerspectivePlan(RendererKind.TRACE, 2, "test")
    planned = CameraPlan(PerspectiveCameraSpec(PerspectiveCamera(20, 10, 1.0)), plan)
    assert (planned.plan_text, planned.bounds) == (str(plan), None)


BALL = make_camera(SphericalMirror(0.03, 0.2), 90)
AUTO = OmniCameraSpec(BALL, RenderSettings(central_error_px=0.25))


@pytest.mark.parametrize(
    ("spec", "is_approximated"),
    [
        (AUTO, True),
        (OmniCameraSpec(BALL, RenderSettings()), False),
        # A tolerance would be used up by the bound of the approximation.
        (
            replace(
                AUTO,
                render_settings=replace(AUTO.render_settings, accuracy_target=AccuracyTarget(0.5)),
            ),
            False,
        ),
        (OmniCameraSpec(SMALL, RenderSettings(central_error_px=0.25)), False),
    ],
)
def test_only_auto_draws_far_scenes_from_one_viewpoint(
    spec: OmniCameraSpec, is_approximated: bool
) -> None:
    frame_plan = make_plans().decide(spec, CAMERA_STATE)
    assert frame_plan.camera.camera.is_approximated is is_approximated  # type: ignore[union-attr] # a mirror
    assert frame_plan.requested is spec
