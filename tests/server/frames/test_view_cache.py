"""Views are prepared on first use, once, and replaced when plans change."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.coordinate_rounding import CoordinateErrors
from catoptra_server.effects.effect import (
    NO_EFFECT_SETTINGS,
    EffectMode,
    EffectSetting,
    EffectSettings,
    ImageEffect,
    SceneSummary,
)
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.sensor.blooming import Blooming
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.frame_plan import ErrorBoundTable
from catoptra_server.frames.plan.camera import OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.candidates import generate_calibration_plans
from catoptra_server.frames.plan.costs import PlanTiming
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererChoice, RendererPool
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.render_settings import AccuracyTarget, MirrorSurface, RenderSettings
from catoptra_server.render.renderer import NO_THRESHOLDS, RenderedImage, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.world_description import Twist
from helpers.mirror_checks import make_camera
from helpers.robots import CAMERA
from helpers.worlds import make_omni_camera

CAMERA_STATE = CameraState(Pose.identity())


class CountingRenderer:
    """Prepares views that render black, and logs all calls; bounds a scene without effects, too."""

    def __init__(self) -> None:
        self.log: list[str] = []
        self.nearest_m = math.inf
        self.drawn: list[PerspectiveCamera | OmniCamera] = []

    def min_distance_m(self, camera_state: CameraState, *, has_ego_body: bool) -> float:
        return self.nearest_m

    def max_rounding_angle_rad(self, camera_state: CameraState, errors: CoordinateErrors) -> float:
        return 1e-6

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> Any:
        self.log.append(f"prepare {camera.width_px}")
        return CountingView(self.log, camera, self.drawn)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        self.log.append(f"prepare omni {camera.width_px}")
        return CountingView(self.log, camera, self.drawn)

    def describe(self) -> str:
        return "counting renderer"

    def close(self) -> None:
        self.log.append("close renderer")


class CountingView:
    memory_bytes = 1000

    def __init__(
        self,
        log: list[str],
        camera: PerspectiveCamera | OmniCamera,
        drawn: list[PerspectiveCamera | OmniCamera] | None = None,
    ) -> None:
        self._log, self._camera = log, camera
        self._drawn = [] if drawn is None else drawn

    def render(self, camera_state: CameraState, *_effects: object) -> RenderedImage:
        self._drawn.append(self._camera)
        shape = (self._camera.height_px, self._camera.width_px, 3)
        return RenderedImage(np.zeros(shape, dtype=np.uint8), {})

    def close(self) -> None:
        self._log.append(f"close {self._camera.width_px}")


def make_cache(renderer: Any, *, capacity: int = 16) -> ViewCache:
    return ViewCache(
        RenderPlanner(RendererPool(RendererChoice(renderer, RendererKind.TRACE, "test"))),
        renderer,  # the effect renderer summarizes its own scene
        max_views=capacity,
    )


def render(views: ViewCache, *widths: int) -> None:
    for width in widths:
        views.render(
            ViewRequest(PerspectiveCameraSpec(PerspectiveCamera(width, 10, 1.0)), CAMERA_STATE)
        )


def test_no_view_is_prepared_before_the_first_frame() -> None:
    renderer = CountingRenderer()
    assert len(make_cache(renderer)) == 0
    assert renderer.log == []


def test_equal_cameras_share_a_view() -> None:
    renderer = CountingRenderer()
    render(make_cache(renderer), 20, 20, 30, 20)
    assert renderer.log == ["prepare 20", "prepare 30"]


def test_mirror_without_a_viewpoint_has_one_while_nothing_is_near() -> None:
    renderer = CountingRenderer()
    bounds = ErrorBoundTable()
    views = ViewCache(
        RenderPlanner(RendererPool(RendererChoice(renderer, RendererKind.TRACE, "test"))),
        renderer,
        error_bounds=bounds,
    )
    ball = make_camera(SphericalMirror(0.03, 0.2), 90)
    spec = OmniCameraSpec(ball, RenderSettings(central_error_px=0.25))
    request = ViewRequest(spec, CAMERA_STATE)
    plans = []
    for renderer.nearest_m in (0.1, 100.0, 0.1):
        plans.append(views.render(request).frame_plan.plan_text)
        assert renderer.drawn[-1].is_approximated == (renderer.nearest_m > 1.0)
        assert bounds.get(spec) is not None
        assert str(views.view_state(spec).choice.plan) == plans[-1]
    assert "exact rays while" in plans[0]
    assert "one viewpoint for all rays" in plans[1]
    assert plans[2] == plans[0]
    # Both views are kept.
    assert renderer.log == ["prepare omni 90"] * 2


def test_view_rendered_longest_ago_is_closed_first() -> None:
    renderer = CountingRenderer()
    views = make_cache(renderer, capacity=2)
    render(views, 20, 30, 20, 40)
    assert renderer.log[-2:] == ["prepare 40", "close 30"]
    assert len(views) == 2


def test_close_frees_all() -> None:
    renderer = CountingRenderer()
    views = make_cache(renderer)
    render(views, 20, 30)
    views.close()
    assert renderer.log[-3:] == ["close 20", "close 30", "close renderer"]
    assert len(views) == 0


def test_omni_camera_is_rendered_by_the_reported_plan() -> None:
    renderer = CountingRenderer()
    views, spec = make_cache(renderer), OmniCameraSpec(CAMERA.camera, CAMERA.render_settings)
    assert "test" in views.prepare(spec)
    views.render(ViewRequest(spec, CAMERA_STATE))
    assert renderer.log == ["prepare omni 8"]


class EffectRenderer(CountingRenderer):
    """Logs the effects of frames and the summaries of a scene with a given radiance."""

    max_radiance = 0.1

    def __init__(self) -> None:
        super().__init__()
        self.changes: dict[str, float] = {}

    def summarize_radiance(self, camera_state: CameraState) -> SceneSummary:
        self.log.append("radiance")
        return SceneSummary(self.max_radiance)

    def summarize(self, camera_state: CameraState, camera: OmniCamera) -> SceneSummary:
        self.log.append("summary")
        return SceneSummary(self.max_radiance)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        super().prepare(camera, plan)
        return EffectView(self.log, camera, self.changes)

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> Any:
        super().prepare_perspective(camera, samples)
        return EffectView(self.log, camera, self.changes)


class EffectView(CountingView):
    def __init__(
        self,
        log: list[str],
        camera: PerspectiveCamera | OmniCamera,
        changes: Mapping[str, float],
    ) -> None:
        super().__init__(log, camera)
        self._changes = changes

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
    ) -> RenderedImage:
        self._log.append(" ".join(("draw", *(effect.name for effect in effects))))
        changes = {name: self._changes[name] for name in thresholds if name in self._changes}
        return replace(super().render(camera_state), changes=changes)


def camera_spec_with(*effects: ImageEffect) -> OmniCameraSpec:
    settings = EffectSettings(tuple(EffectSetting(effect, EffectMode.AUTO) for effect in effects))
    return OmniCameraSpec(CAMERA.camera, CAMERA.render_settings, settings)


def test_camera_without_effects_summarizes_no_scene() -> None:
    renderer = EffectRenderer()
    view = make_cache(renderer).render(ViewRequest(camera_spec_with(), CAMERA_STATE))
    assert (renderer.log, view.effect_decisions) == (["prepare omni 8", "draw"], ())


def test_camera_when_its_effects_are_negligible_is_rendered_without_and_reports_why() -> None:
    renderer = EffectRenderer()
    view = make_cache(renderer).render(
        ViewRequest(camera_spec_with(Quantisation(12)), CAMERA_STATE)
    )
    assert renderer.log == ["radiance", "prepare omni 8", "draw"]
    assert [(one.effect, one.enabled) for one in view.effect_decisions] == [("Quantisation", False)]


def test_perspective_camera_decides_and_draws_effects_as_a_mirror_does() -> None:
    renderer = EffectRenderer()
    settings = EffectSettings(
        tuple(
            EffectSetting(effect, EffectMode.AUTO)
            for effect in (Blooming(0.1, 8.0), Quantisation(8), Quantisation(12))
        )
    )
    spec = PerspectiveCameraSpec(PerspectiveCamera(8, 6, 1.0), settings)
    view = make_cache(renderer).render(ViewRequest(spec, CAMERA_STATE))
    assert renderer.log[:2] == ["radiance", "prepare 8"]
    assert renderer.log[-1].split()[0] == "draw"
    drawn = [one.effect for one in view.effect_decisions if one.enabled]
    assert "Quantisation" in drawn
    assert renderer.log[-1].split()[1:] == drawn
    assert len(view.effect_decisions) == 3


def test_perspective_camera_without_effects_summarizes_no_scene() -> None:
    renderer = EffectRenderer()
    spec = PerspectiveCameraSpec(PerspectiveCamera(8, 6, 1.0))
    view = make_cache(renderer).render(ViewRequest(spec, CAMERA_STATE))
    assert (renderer.log, view.effect_decisions) == (["prepare 8", "draw"], ())
    assert view.frame_plan.bounds is None


def test_camera_when_a_state_calls_for_an_effect_keeps_its_view() -> None:
    renderer = EffectRenderer()
    views, spec = make_cache(renderer), camera_spec_with(Blooming(0.1, 8.0), Quantisation(8))
    rendered = []
    for renderer.max_radiance in (0.1, 3.0, 0.1):
        rendered.append(views.render(ViewRequest(spec, CAMERA_STATE)))
    log = [entry for entry in renderer.log if entry != "radiance"]
    expected = ["draw Quantisation", "draw Blooming Quantisation", "draw Quantisation"]
    assert log == ["prepare omni 8", *expected]
    assert [[one.enabled for one in view.effect_decisions] for view in rendered] == [
        [False, True],
        [True, True],
        [False, True],
    ]


def test_camera_when_the_frame_shows_no_effect_reports_it_as_off_by_measurement() -> None:
    renderer, spec = EffectRenderer(), camera_spec_with(Quantisation(8))
    views, rendered = make_cache(renderer), []
    for change in (0.25, 0.75):
        renderer.changes["Quantisation"] = change
        rendered += views.render(ViewRequest(spec, CAMERA_STATE)).effect_decisions
    assert [(one.enabled, one.basis.value, one.change) for one in rendered] == [
        (False, "measured", 0.25),
        (True, "measured", 0.75),
    ]


def test_camera_when_its_effects_read_geometry_summarizes_the_whole_scene() -> None:
    renderer = EffectRenderer()
    make_cache(renderer).render(
        ViewRequest(camera_spec_with(Fog(1e-6, 0.5, 0.5, 0.5)), CAMERA_STATE)
    )
    assert renderer.log[:2] == ["summary", "prepare omni 8"]


def test_decisions_when_only_a_bound_moves_are_reported_but_not_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    renderer, spec = EffectRenderer(), camera_spec_with(Vignetting(), Quantisation(8))
    views, rendered = make_cache(renderer), []
    with caplog.at_level(logging.INFO):
        for renderer.max_radiance in (0.4, 0.6, 0.8):
            rendered.append(views.render(ViewRequest(spec, CAMERA_STATE)))
    assert len({view.effect_decisions for view in rendered}) == 3
    assert sum("effects:" in record.message for record in caplog.records) == 1


class SlowRenderer:
    """Views take `ms_per_sample` on a fake clock for each sample of a pixel."""

    def max_rounding_angle_rad(self, camera_state: CameraState, errors: CoordinateErrors) -> float:
        return 1e-6

    def __init__(self, ms_per_sample: float) -> None:
        self.ms_per_sample = ms_per_sample
        self.now_s = 0.0
        self.plans: list[RenderPlan] = []

    def describe(self) -> str:
        return "slow"

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        self.plans.append(plan)
        return SlowView(self, plan)

    def close(self) -> None:
        pass


class SlowView:
    memory_bytes = 1000

    def __init__(self, renderer: SlowRenderer, plan: RenderPlan) -> None:
        self._renderer, self._plan = renderer, plan

    def render(self, camera_state: CameraState, *_effects: object) -> RenderedImage:
        ms = self._renderer.ms_per_sample * self._plan.samples**2
        self._renderer.now_s += 1e-3 * ms
        return RenderedImage(np.zeros((6, 8, 3), dtype=np.uint8), {"trace": ms})

    def close(self) -> None:
        pass


def make_budgeted_cache(
    renderer: SlowRenderer, budget_ms: float, published: ErrorBoundTable | None = None
) -> tuple[ViewCache, ViewRequest]:
    """Views of a renderer that was measured at 1 ms a sample, and a request for one."""
    render_settings = replace(
        CAMERA.render_settings, accuracy_target=AccuracyTarget(budget_ms=budget_ms)
    )

    def measure(
        renderer: object, kind: RendererKind, camera: OmniCamera, surface: MirrorSurface, *_: object
    ) -> list[PlanTiming]:
        plans = generate_calibration_plans(kind, camera, surface)
        return [PlanTiming(plan, {"trace": 1.0 * plan.samples**2}) for plan in plans]

    choice = RendererChoice(renderer, RendererKind.TRACE, "test")  # type: ignore[arg-type] # enough of one
    planning = RenderPlanner(RendererPool(choice), measure=measure)
    views = ViewCache(planning, renderer, clock=lambda: renderer.now_s, error_bounds=published)
    return views, ViewRequest(OmniCameraSpec(CAMERA.camera, render_settings), CAMERA_STATE)


def render_repeatedly(views: ViewCache, request: ViewRequest, frames: int) -> None:
    for _ in range(frames):
        views.render(request)


def test_plan_of_a_frame_when_replanning_is_the_one_that_rendered_the_frame() -> None:
    renderer = SlowRenderer(2.0)
    views, request = make_budgeted_cache(renderer, 10.0)
    for _ in range(100):
        rendered = views.render(request)
        samples = math.sqrt(rendered.image.stage_ms["trace"] / 2.0)
        assert f" {samples:.0f}^2 samples" in rendered.frame_plan.plan_text


def test_plan_and_bounds_are_formatted_once_a_plan() -> None:
    views, request = make_budgeted_cache(SlowRenderer(1.0), 10.0)
    first, second = views.render(request), views.render(request)
    assert first.frame_plan.plan_text is second.frame_plan.plan_text
    assert first.frame_plan.bounds is second.frame_plan.bounds is not None


def test_view_state_when_requested_prepares_no_view() -> None:
    renderer = SlowRenderer(1.0)
    views, request = make_budgeted_cache(renderer, 10.0)
    assert isinstance(request.camera, OmniCameraSpec)
    state = views.view_state(request.camera)
    assert (state.choice.plan.samples, state.median_ms, renderer.plans) == (3, None, [])
    render_repeatedly(views, request, 30)
    assert views.view_state(request.camera).median_ms == pytest.approx(9.0)


def test_bound_of_a_prepared_view_is_published() -> None:
    published = ErrorBoundTable()
    views, request = make_budgeted_cache(SlowRenderer(1.0), 10.0, published)
    assert published.get(request.camera) is None
    rendered = views.render(request)
    bound = published.get(request.camera)
    assert bound is not None
    assert rendered.frame_plan.bounds == bound.as_dict()


def test_perspective_camera_has_no_bound() -> None:
    request = ViewRequest(PerspectiveCameraSpec(PerspectiveCamera(20, 10, 1.0)), CAMERA_STATE)
    assert make_cache(CountingRenderer()).render(request).frame_plan.bounds is None


def spec_with_tolerance(max_error_px: float) -> OmniCameraSpec:
    target = AccuracyTarget(max_error_px=max_error_px)
    return OmniCameraSpec(
        CAMERA.camera, replace(CAMERA.render_settings, accuracy_target=target), NO_EFFECT_SETTINGS
    )


def test_hundred_tolerances_need_a_view_for_each_of_a_few_plans() -> None:
    renderer = SlowRenderer(1.0)
    views, _ = make_budgeted_cache(renderer, 10.0)
    for tolerance_px in np.geomspace(0.08, 3.0, 100).tolist():
        views.render(ViewRequest(spec_with_tolerance(tolerance_px), CAMERA_STATE))
    assert 2 < len(renderer.plans) == len(views) <= 8


def test_frame_with_fewer_time_samples_than_its_motion_needs_says_so() -> None:
    blur = EffectSettings((EffectSetting(MotionBlur(0.1), EffectMode.ALWAYS),))
    camera = make_omni_camera(width_px=400)
    spec = OmniCameraSpec(camera, replace(CAMERA.render_settings, samples=8), blur)
    states: list[CameraState] = []

    class ShutterView(EffectView):
        def render(
            self,
            camera_state: CameraState,
            effects: tuple[ImageEffect, ...] = (),
            thresholds: Mapping[str, float] = NO_THRESHOLDS,
        ) -> RenderedImage:
            states.append(camera_state)
            return super().render(camera_state, effects)

    class ShutterRenderer(EffectRenderer):
        def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
            return ShutterView(self.log, camera, {})

        def summarize(self, camera_state: CameraState, camera: OmniCamera) -> SceneSummary:
            return SceneSummary(0.1, scene_twist=Twist((0.0, 0.0, 0.0), (0.0, 0.0, 2.0)))

    view = make_cache(ShutterRenderer()).render(ViewRequest(spec, CAMERA_STATE))
    (decision,) = view.effect_decisions
    shutter = states[0].shutter
    assert shutter is not None
    assert shutter.num_time_samples == 3
    assert "; 3 of " in decision.reason
