"""Views: prepared once, bounded in memory, drawn as decided, labelled, renewed after faults."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import (
    EFFECT_TYPES,
    CaptureContext,
    EffectChange,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
    ImageEffect,
    SceneSummary,
    Threshold,
)
from catoptra_server.effects.bounds.coordinate_rounding import CoordinateErrors
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.sensor.blooming import Blooming
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.frames import views as views_module
from catoptra_server.frames.frame import CameraChannel, FrameLabels, ViewRequest
from catoptra_server.frames.frame_plan import ErrorBoundTable
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.plans import PlanChoice, plan_from_settings
from catoptra_server.frames.renderers import (
    RendererChoice,
    RendererPool,
    choose_renderer,
    create_renderer,
)
from catoptra_server.frames.views import RenderedView, ViewCache, ViewFailedError
from catoptra_server.render.renderer import (
    NO_THRESHOLDS,
    AccuracyTarget,
    MirrorSurface,
    PerPixel,
    RenderedImage,
    Renderer,
    RenderPlan,
    RenderSettings,
    Tessellation,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Twist
from helpers.effect_measurement import make_effect
from helpers.invented_costs import measure_per_sample
from helpers.labelled_rooms import CAMERAS, SCENE, STATE, WORLD
from helpers.mirror_checks import make_camera
from helpers.opengl import device_or_skip
from helpers.robots import CAMERA
from helpers.worlds import make_omni_camera, make_test_world

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
CAMERA_STATE = CameraState(Pose.identity())


class InjectedError(Exception):
    """A fault of a renderer, not an error that Catoptra raises."""


class FakeScene:
    """Bounds of a scene, as dark and as near as a test says; logs which of them are read."""

    def __init__(self, log: list[str]) -> None:
        self._log = log
        self.scene = SCENE
        self.max_radiance = 0.1
        self.nearest_m = math.inf
        self.twist = Twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def min_distance_m(self, camera_state: CameraState, *, has_ego_body: bool) -> float:
        return self.nearest_m

    def max_rounding_angle_rad(self, camera_state: CameraState, errors: CoordinateErrors) -> float:
        return 1e-6

    def summarize(
        self,
        camera_state: CameraState,
        camera: OmniCamera,
        fields: frozenset[str],
        gains: tuple[float, float],
    ) -> SceneSummary:
        is_radiance = fields <= {"max_radiance"}
        self._log.append("radiance" if is_radiance else f"summary of {sorted(fields)}")
        return SceneSummary(self.max_radiance, scene_twist=self.twist)


class FakeRenderer:
    """Renders black in a view of as many bytes as a pixel's side has samples."""

    def __init__(self, fakes: Fakes, name: str) -> None:
        self._fakes, self._name = fakes, name
        fakes.lifetimes.append(f"create {name}")

    def describe(self) -> str:
        return self._name

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        return self.prepare_perspective(camera, plan.samples)

    def prepare_perspective(self, camera: Any, samples: int) -> Any:
        self._fakes.raise_at(f"{self._name} prepare")
        self._fakes.log.append(f"prepare {camera.width_px}")
        self._fakes.prepared.append(samples)
        return FakeView(self._fakes, self._name, camera, samples)

    def close(self) -> None:
        self._fakes.lifetimes.append(f"close {self._name}")
        self._fakes.raise_at(f"{self._name} close")


class FakeView:
    def __init__(self, fakes: Fakes, name: str, camera: Any, samples: int) -> None:
        self._fakes, self._name, self._camera, self._samples = fakes, name, camera, samples
        self.memory_bytes = samples
        fakes.newest_view = self

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, Threshold] = NO_THRESHOLDS,
    ) -> RenderedImage:
        fakes = self._fakes
        fakes.raise_at(f"{self._name} render")
        fakes.log.append(" ".join(("draw", *(effect.name for effect in effects))))
        fakes.drawn.append((self._camera, camera_state))
        ms = fakes.ms_per_sample * self._samples**2
        fakes.now_s += 1e-3 * ms
        image = np.zeros((self._camera.height_px, self._camera.width_px, 3), dtype=np.float32)
        for effect in effects:
            image = effect.apply(image, self._camera, CaptureContext())
        changes = {name: fakes.changes[name] for name in thresholds if name in fakes.changes}
        return RenderedImage(image.astype(np.uint8), {"trace": ms}, changes=changes)

    def close(self) -> None:
        self._fakes.closed.append(self._samples)
        self._fakes.log.append(f"close {self._camera.width_px}")
        self._fakes.raise_at(f"{self._name} close view")


class Fakes:
    """Views of a fake trace renderer, with raster as its alternative, and all that happens there.

    Args:
        faults: Places, such as "trace render", where the renderers raise once each.
        named: Whether the renderer was requested by name.
        limits: Limits of the views, and the table that bounds are published in.
    """

    def __init__(
        self, *faults: str, may_replace: bool = True, named: bool = False, **limits: Any
    ) -> None:
        self.lifetimes = list[str]()
        self.log = list[str]()
        self.prepared, self.closed = list[int](), list[int]()
        self.drawn = list[tuple[Any, CameraState]]()
        self.changes = dict[str, EffectChange]()
        self.ms_per_sample, self.now_s = 1.0, 0.0
        self.newest_view: FakeView | None = None
        self.scene = FakeScene(self.log)
        self.faults = list[str]()
        create: dict[RendererKind, Callable[[], Any]] = {
            kind: partial(self._create, kind.value) for kind in RendererKind
        }
        factories = {TRACE: create[TRACE]} if named else create
        choice = RendererChoice(create[TRACE](), TRACE, "test", factories)
        pool = RendererPool(choice, may_replace=may_replace)
        scene: Any = self.scene
        self.views = ViewCache(
            RenderPlanner(pool, measure=measure_per_sample()),
            scene,
            clock=lambda: self.now_s,
            **limits,
        )
        self.faults.extend(faults)

    def _create(self, name: str) -> FakeRenderer:
        self.raise_at(f"{name} create")
        return FakeRenderer(self, name)

    def raise_at(self, place: str) -> None:
        if place in self.faults:
            self.faults.remove(place)
            raise InjectedError(place)

    def render(self, *cameras: CameraSpec) -> RenderedView:
        """Render the cameras in turn; the last image."""
        return [self.views.render(ViewRequest(camera, CAMERA_STATE)) for camera in cameras][-1]

    @property
    def open_bytes(self) -> int:
        return sum(self.prepared) - sum(self.closed)


def lens(width_px: int = 20, *effects: ImageEffect) -> PerspectiveCameraSpec:
    return PerspectiveCameraSpec(PerspectiveCamera(width_px, 10, 1.0), auto(*effects))


def mirror(*effects: ImageEffect, **settings: Any) -> OmniCameraSpec:
    return OmniCameraSpec(
        CAMERA.camera, replace(CAMERA.render_settings, **settings), auto(*effects)
    )


def auto(*effects: ImageEffect, mode: EffectMode = EffectMode.AUTO) -> EffectSettings:
    return EffectSettings(tuple(EffectSetting(effect, mode) for effect in effects))


def sampled(*numbers: int) -> list[OmniCameraSpec]:
    """A camera for each number of samples, which its view has as bytes."""
    return [mirror(samples=samples) for samples in numbers]


LENS, MIRROR = lens(), mirror()


# --- Preparation and memory


def test_cameras_of_one_plan_share_a_view_whatever_effects_they_have() -> None:
    fakes = Fakes()
    fakes.render(lens(20), lens(20), lens(30), lens(20))
    assert [entry for entry in fakes.log if entry != "draw"] == ["prepare 20", "prepare 30"]
    other = replace(MIRROR, effect_settings=EffectSettings(threshold_px=0.1))
    fakes.render(MIRROR, other, mirror(samples=3))
    assert fakes.prepared[2:] == [2, 3]


def test_view_prepared_ahead_is_the_one_that_draws() -> None:
    fakes = Fakes()
    assert "test" in fakes.views.prepare(MIRROR)
    fakes.render(MIRROR)
    assert fakes.log == ["prepare 8", "draw"]


@pytest.mark.parametrize(
    ("limits", "samples", "closed", "num_bytes"),
    [
        ({"max_bytes": 9}, (2, 3, 4, 2, 5), [3, 4], 7),
        ({"max_bytes": 6}, (2, 3, 8), [2, 3], 8),  # one is kept whatever its size
        ({"max_bytes": 6}, (2, 3, 8, 8), [2, 3], 8),
        ({"max_views": 2}, (2, 3, 4), [2], 7),
        ({"max_views": 2}, (2, 3, 2, 4), [3], 6),
    ],
)
def test_views_used_longest_ago_are_closed_beyond_the_limits(
    limits: dict[str, int], samples: tuple[int, ...], closed: list[int], num_bytes: int
) -> None:
    fakes = Fakes(**limits)
    fakes.render(*sampled(*samples))
    assert (fakes.closed, fakes.open_bytes) == (closed, num_bytes)
    assert len(fakes.views) == len(fakes.prepared) - len(closed)


@pytest.mark.parametrize(
    ("first", "then", "closed"),
    [((2, 3), (3,), [2]), ((2,), (2, 3), [2])],
    ids=["beside another", "while it was alone"],
)
def test_view_that_has_grown_counts_with_its_new_size(
    first: tuple[int, ...], then: tuple[int, ...], closed: list[int]
) -> None:
    fakes = Fakes(max_bytes=9)
    fakes.render(*sampled(*first))
    assert fakes.newest_view is not None
    fakes.newest_view.memory_bytes = 8
    fakes.render(*sampled(*then))
    assert fakes.closed == closed


def test_view_that_nobody_requests_is_closed_but_for_the_one_prepared_at_the_start() -> None:
    fakes = Fakes()
    own, *others = sampled(2, 3, 4)
    fakes.views.prepare(own)
    fakes.render(*others)
    fakes.now_s += 5.0
    fakes.render(others[1])
    fakes.now_s += 5.0
    fakes.views.close_idle()
    assert fakes.closed == [3]
    fakes.now_s += 100.0
    fakes.views.close_idle()
    assert (fakes.closed, len(fakes.views)) == ([3, 4], 1)


def test_freed_memory_is_given_back_once_enough_was_prepared_and_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    releases: list[int] = []
    monkeypatch.setattr(views_module, "release_freed_memory", lambda: releases.append(1))
    monkeypatch.setattr(views_module, "_RELEASE_BYTES", 5)
    fakes = Fakes(max_bytes=6)
    counts = []
    for camera in sampled(2, 2, 3, 3, 4, 4):
        fakes.render(camera)
        counts.append(len(releases))
    # 2 and 3 bytes prepared; 4 prepared and 2 + 3 closed for them; frames alone change nothing.
    assert counts == [0, 0, 1, 1, 2, 2]


def test_close_frees_all() -> None:
    fakes = Fakes()
    fakes.render(lens(20), lens(30))
    fakes.views.close()
    assert fakes.log[-2:] == ["close 20", "close 30"]
    assert fakes.lifetimes == ["create trace", "close trace"]
    assert len(fakes.views) == 0


def create_or_skip(kind: RendererKind) -> Renderer:
    if kind is RASTER:
        device_or_skip().close()
    world = make_test_world()
    return create_renderer(kind, build_scene(world), world)


SIZED = make_omni_camera(width_px=100)
SIZED_STATE = CameraState(Pose.from_rpy((0.0, 0.0, -0.6)))


def plan_of(samples: int, kind: RendererKind) -> RenderPlan:
    return plan_from_settings(RenderSettings(samples=samples), SIZED, kind=kind, reason="test")


@pytest.mark.parametrize("kind", list(RendererKind))
def test_view_states_the_size_of_its_rays_or_images(kind: RendererKind) -> None:
    renderer = create_or_skip(kind)
    sizes = []
    for samples in (1, 2, 4):
        view = renderer.prepare(SIZED, plan_of(samples, kind))
        view.render(SIZED_STATE)
        sizes.append(view.memory_bytes)
        view.close()
    # 12 bytes a ray, 8 a sample of the lookup map, over the mirror's disc or the whole image.
    per_sample = 12 * 0.25 * math.pi if kind is TRACE else 8
    growth = np.diff(sizes) / (100 * 100 * np.diff([1, 4, 16]))
    assert growth == pytest.approx(per_sample, rel=0.25)
    assert sizes[0] > 100 * 100 * per_sample
    renderer.close()


@pytest.mark.parametrize("kind", list(RendererKind))
def test_view_grows_by_the_images_of_effects(kind: RendererKind) -> None:
    renderer = create_or_skip(kind)
    view = renderer.prepare(SIZED, plan_of(1, kind))
    view.render(SIZED_STATE)
    before = view.memory_bytes
    view.render(SIZED_STATE, (make_effect("DefocusByDepth"),))
    # Ranges of all pixels, a texel of 4 bytes at least; rays that are traced have them already.
    assert view.memory_bytes - before > (0 if kind is TRACE else 100 * 100 * 4) - 1
    view.close()
    through_lens = renderer.prepare_perspective(PerspectiveCamera(100, 50, 1.0), 2)
    assert through_lens.memory_bytes > 100 * 50 * 4 * 8
    through_lens.close()
    renderer.close()


# --- Plans, viewpoints and bounds of the drawn frames


def test_mirror_without_a_viewpoint_has_one_while_nothing_is_near() -> None:
    bounds = ErrorBoundTable()
    fakes = Fakes(error_bounds=bounds)
    ball = make_camera(SphericalMirror(0.03, 0.2), 90)
    spec = OmniCameraSpec(ball, RenderSettings(central_error_px=0.25))
    plans = []
    for fakes.scene.nearest_m in (0.1, 100.0, 0.1):
        plans.append(fakes.render(spec).frame_plan.plan_text)
        assert fakes.drawn[-1][0].is_approximated == (fakes.scene.nearest_m > 1.0)
        assert bounds.get(spec) is not None
        assert str(fakes.views.view_state(ViewRequest(spec, CAMERA_STATE)).choice.plan) == plans[-1]
    assert "exact rays while" in plans[0]
    assert "one viewpoint for all rays" in plans[1]
    assert plans[2] == plans[0]
    # Both views are kept.
    assert [entry for entry in fakes.log if entry != "draw"] == ["prepare 90"] * 2


def budgeted(budget_ms: float = 10.0) -> OmniCameraSpec:
    return mirror(accuracy_target=AccuracyTarget(budget_ms=budget_ms))


def test_plan_of_a_frame_when_replanning_is_the_one_that_rendered_the_frame() -> None:
    fakes = Fakes(named=True)
    fakes.ms_per_sample = 2.0
    for _ in range(100):
        rendered = fakes.render(budgeted())
        samples = math.sqrt(rendered.image.stage_ms["trace"] / 2.0)
        assert f" {samples:.0f}^2 samples" in rendered.frame_plan.plan_text


def test_view_state_when_requested_prepares_no_view() -> None:
    fakes = Fakes(named=True)
    state = fakes.views.view_state(ViewRequest(budgeted(), CAMERA_STATE))
    assert (state.choice.plan.samples, state.median_ms, fakes.prepared) == (3, None, [])
    fakes.render(*[budgeted()] * 30)
    assert fakes.views.view_state(ViewRequest(budgeted(), CAMERA_STATE)).median_ms == pytest.approx(
        9.0
    )


def test_bound_of_a_prepared_view_is_published() -> None:
    published = ErrorBoundTable()
    fakes = Fakes(error_bounds=published)
    assert published.get(MIRROR) is None
    rendered = fakes.render(MIRROR)
    bound = published.get(MIRROR)
    assert bound is not None
    assert rendered.frame_plan.bounds == bound.numbers_by_name()


def test_hundred_tolerances_need_a_view_for_each_of_a_few_plans() -> None:
    fakes = Fakes(named=True)
    for tolerance_px in np.geomspace(0.08, 3.0, 100).tolist():
        fakes.render(mirror(accuracy_target=AccuracyTarget(max_error_px=tolerance_px)))
    assert 2 < len(fakes.prepared) == len(fakes.views) <= 8


# --- Effects


@pytest.mark.parametrize("camera", [mirror(), lens(8)], ids=["mirror", "lens"])
def test_camera_without_effects_summarizes_no_scene(camera: CameraSpec) -> None:
    fakes = Fakes()
    rendered = fakes.render(camera)
    assert (fakes.log, rendered.effect_decisions) == (["prepare 8", "draw"], ())
    assert (rendered.frame_plan.bounds is None) == isinstance(camera, PerspectiveCameraSpec)


def test_camera_when_its_effects_are_negligible_is_rendered_without_and_reports_why() -> None:
    fakes = Fakes()
    rendered = fakes.render(mirror(Quantisation(12)))
    assert fakes.log == ["radiance", "prepare 8", "draw"]
    (decision,) = rendered.effect_decisions
    assert (decision.effect, decision.enabled) == ("Quantisation", False)


def test_perspective_camera_decides_and_draws_effects_as_a_mirror_does() -> None:
    fakes = Fakes()
    rendered = fakes.render(lens(8, Blooming(0.1, 8.0), Quantisation(8), Quantisation(12)))
    assert fakes.log[:2] == ["radiance", "prepare 8"]
    drawn = [one.effect for one in rendered.effect_decisions if one.enabled]
    assert "Quantisation" in drawn
    assert fakes.log[-1].split() == ["draw", *drawn]
    assert len(rendered.effect_decisions) == 3


def test_camera_when_a_state_calls_for_an_effect_keeps_its_view() -> None:
    fakes, spec = Fakes(), mirror(Blooming(0.1, 8.0), Quantisation(8))
    enabled = []
    for fakes.scene.max_radiance in (0.1, 3.0, 0.1):
        enabled.append([one.enabled for one in fakes.render(spec).effect_decisions])
    log = [entry for entry in fakes.log if entry != "radiance"]
    expected = ["draw Quantisation", "draw Blooming Quantisation", "draw Quantisation"]
    assert log == ["prepare 8", *expected]
    assert enabled == [[False, True], [True, True], [False, True]]


def test_camera_when_the_frame_shows_no_effect_reports_it_as_off_by_measurement() -> None:
    fakes, decisions = Fakes(), []
    for fakes.changes["Quantisation"] in (EffectChange(0.25), EffectChange(2.25)):
        decisions += fakes.render(mirror(Quantisation(8))).effect_decisions
    assert [(one.enabled, one.basis.value, one.change) for one in decisions] == [
        (False, "measured", 0.25),
        (True, "measured", 2.25),
    ]


def test_camera_summarizes_what_its_effects_read() -> None:
    fakes, fog = Fakes(), Fog(1e-6, 0.5, 0.5, 0.5)
    fakes.render(mirror(fog))
    assert fakes.log[:2] == [f"summary of {sorted(fog.reads)}", "prepare 8"]


def test_decisions_when_only_a_bound_moves_are_reported_but_not_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    fakes, spec, decisions = Fakes(), mirror(Vignetting(), Quantisation(8)), set()
    with caplog.at_level(logging.INFO):
        for fakes.scene.max_radiance in (0.4, 0.6, 0.8):
            decisions.add(fakes.render(spec).effect_decisions)
    assert len(decisions) == 3
    assert sum("effects:" in record.message for record in caplog.records) == 1


def test_frame_with_fewer_time_samples_than_its_motion_needs_says_so() -> None:
    fakes = Fakes()
    fakes.scene.twist = Twist((0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    settings = replace(CAMERA.render_settings, samples=8)
    blur = auto(MotionBlur(0.1), mode=EffectMode.ALWAYS)
    rendered = fakes.render(OmniCameraSpec(make_omni_camera(width_px=400), settings, blur))
    (decision,) = rendered.effect_decisions
    shutter = fakes.drawn[-1][1].shutter
    assert shutter is not None
    assert shutter.num_time_samples == 3
    assert "; 3 of " in decision.reason


# --- Faults

BOTH_KINDS = pytest.mark.parametrize("camera", [LENS, MIRROR], ids=["lens", "mirror"])
PLACES = pytest.mark.parametrize("place", ["prepare", "render"])


@BOTH_KINDS
@PLACES
def test_renderer_that_raises_once_is_made_anew_and_renders_the_frame(
    camera: CameraSpec, place: str, caplog: pytest.LogCaptureFixture
) -> None:
    fakes = Fakes(f"trace {place}", "trace close", "trace close view")
    rendered = fakes.render(camera)
    assert rendered.frame_plan.plan_text.startswith("trace")
    assert "failed" not in rendered.frame_plan.plan_text
    assert fakes.lifetimes == ["create trace", "close trace", "create trace"]
    # A view of the old renderer is not used again, although it was the last one.
    assert len(fakes.prepared) == (2 if place == "render" else 1)
    assert "trace failed to render a view and is made anew" in caplog.text


def test_views_of_a_faulty_renderer_are_closed_together_and_no_others() -> None:
    fakes = Fakes()
    fakes.render(mirror(renderer="raster"), *sampled(2, 3), LENS)
    # One of them cannot even be closed.
    fakes.faults += ["trace render", "trace close view"]
    fakes.render(mirror(samples=3))
    assert fakes.closed == [2, 2, 3]
    assert fakes.lifetimes[-2:] == ["close trace", "create trace"]
    assert len(fakes.views) == 2


@BOTH_KINDS
@pytest.mark.parametrize(
    "faults",
    [
        ("trace prepare", "trace prepare"),
        ("trace render", "trace render"),
        ("trace prepare", "trace render"),
        ("trace render", "trace create"),
    ],
)
def test_renderer_that_raises_twice_is_replaced_and_the_plan_says_so(
    camera: CameraSpec, faults: tuple[str, ...]
) -> None:
    fakes = Fakes(*faults)
    for _ in range(2):
        plan_text = fakes.render(camera).frame_plan.plan_text
        assert plan_text.startswith("raster")
        assert "raster in place of trace, which failed" in plan_text
    assert fakes.faults == []
    assert fakes.lifetimes[-1] == "create raster"


@BOTH_KINDS
@PLACES
@pytest.mark.parametrize("settings", [{"may_replace": False}, {"named": True}], ids=str)
def test_view_is_refused_under_lockstep_and_by_a_named_renderer(
    camera: CameraSpec, place: str, settings: dict[str, bool]
) -> None:
    fakes = Fakes(*2 * (f"trace {place}",), **settings)
    with pytest.raises(ViewFailedError, match="trace failed to render the view: see the server"):
        fakes.render(camera)
    assert fakes.render(camera).frame_plan.plan_text.startswith("trace")


@BOTH_KINDS
@PLACES
def test_view_that_fails_on_all_renderers_leaves_the_first_one_working(
    camera: CameraSpec, place: str
) -> None:
    fakes = Fakes(*2 * (f"trace {place}",), f"raster {place}")
    with pytest.raises(ViewFailedError, match="trace and raster failed to render the view"):
        fakes.render(camera)
    for other in (LENS, MIRROR):
        plan_text = fakes.render(other).frame_plan.plan_text
        assert plan_text.startswith("trace")
        assert "failed" not in plan_text


@PLACES
def test_view_that_no_renderer_could_draw_is_refused_without_a_new_renderer(
    place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fakes = Fakes()

    def refuse(*_: object) -> None:
        raise DomainError("too many samples")

    with monkeypatch.context() as patch:
        patch.setattr(FakeRenderer if place == "prepare" else FakeView, place, refuse)
        with pytest.raises(ViewFailedError, match="too many samples"):
            fakes.render(MIRROR)
    assert fakes.lifetimes == ["create trace"]
    assert fakes.render(MIRROR).frame_plan.plan_text.startswith("trace")


def test_planning_that_raises_refuses_the_view_and_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fakes = Fakes()

    def fail(*_: object) -> PlanChoice:
        raise InjectedError

    with monkeypatch.context() as patch:
        patch.setattr(RenderPlanner, "choose_plan", fail)
        with pytest.raises(ViewFailedError, match="could not be decided"):
            fakes.render(MIRROR)
        fakes.render(LENS)
    fakes.render(MIRROR)


def test_view_prepared_ahead_is_prepared_by_a_new_renderer_after_a_fault() -> None:
    fakes = Fakes("trace prepare")
    assert "test" in fakes.views.prepare(MIRROR)
    assert len(fakes.views) == 1


@pytest.mark.parametrize("type_", EFFECT_TYPES.values(), ids=lambda type_: type_.name)
@pytest.mark.parametrize("place", ["bound", "apply"])
def test_effect_that_raises_refuses_its_view_and_no_other(
    type_: EffectType, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    effect = type_.factory(**{each.field: each.default for each in type_.parameters})
    method = "apply_to_scene" if place == "apply" and effect.changes_scene else place
    always = auto(cast(Any, effect), mode=EffectMode.ALWAYS)
    fakes = Fakes()

    def fail(*_: object) -> None:
        raise InjectedError(type_.name)

    with monkeypatch.context() as patch:
        patch.setattr(type(effect), method, fail)
        is_decision = place == "bound" or effect.changes_scene
        reason = "could not be decided, InjectedError" if is_decision else "trace and raster failed"
        with pytest.raises(ViewFailedError, match=reason):
            fakes.render(replace(MIRROR, effect_settings=always))
        # A criterion is no renderer's fault: the renderer stays.
        assert (fakes.lifetimes == ["create trace"]) == is_decision
        assert fakes.render(MIRROR).frame_plan.plan_text.startswith("trace")


# --- Labels

PAPER = OmniCameraSpec(CAMERAS["paper"], RenderSettings(samples=2))
LATER = replace(STATE, world_from_mirror=Pose.from_rpy((0.35, 0.17, -0.6), (0.02, -0.03, 0.3)))


@pytest.fixture
def views() -> Iterator[ViewCache]:
    choice = choose_renderer("trace", SCENE, WORLD, threads=1)
    found = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(SCENE, WORLD))
    yield found
    found.close()


def label(
    views: ViewCache,
    channels: tuple[str, ...],
    time_s: float = 1.0,
    *,
    spec: OmniCameraSpec = PAPER,
    state: CameraState = STATE,
    robot: str = "Mine",
) -> FrameLabels:
    """Labels of a frame that is rendered for them."""
    rendered = views.render(ViewRequest(spec, state, channels))
    return views.label(rendered, CameraChannel(robot, "Omni"), time_s)


def test_flow_leads_to_the_last_frame_of_the_same_channel(views: ViewCache) -> None:
    first = label(views, ("flow",))
    other = label(views, ("flow",), 1.5, robot="Other")
    second = label(views, ("flow",), 2.0, state=LATER)
    assert (first.flow_to_time_s, other.flow_to_time_s) == (None, None)
    assert np.isnan(first.truth.channels["flow"]).all()
    assert second.flow_to_time_s == 1.0
    assert np.nanmax(np.abs(second.truth.channels["flow"])) > 0.5


def test_frames_without_flow_are_not_remembered(views: ViewCache) -> None:
    label(views, ("ids",), 1.0)
    assert label(views, ("flow",), 2.0).flow_to_time_s is None


def test_displaced_camera_is_reported(views: ViewCache) -> None:
    displaced = auto(Misalignment(x_m=0.002), mode=EffectMode.ALWAYS)
    assert label(views, ("ids",), spec=replace(PAPER, effect_settings=displaced)).is_displaced
    assert not label(views, ("ids",)).is_displaced


def test_labels_of_a_huge_image_are_rejected(views: ViewCache) -> None:
    rendered = views.render(ViewRequest(PAPER, STATE, ("point",)))
    huge = replace(PAPER, camera=replace(CAMERAS["fish-eye"], width_px=4096, height_px=4096))
    rendered = replace(rendered, frame_plan=replace(rendered.frame_plan, requested=huge))
    with pytest.raises(ViewFailedError, match="4096 x 4096 px take 192 MiB, more than 64"):
        views.label(rendered, CameraChannel("Mine", "Omni"), 1.0)


def test_labels_that_are_too_large_leave_the_picture_alone(
    views: ViewCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(views_module, "_MAX_CHANNEL_BYTES", 100)
    assert views.render(ViewRequest(PAPER, STATE, ("point",))).labels is None


def test_labels_go_on_after_all_rays_were_closed(views: ViewCache) -> None:
    before = label(views, ("ids",))
    views.close()
    after = label(views, ("ids",))
    np.testing.assert_array_equal(before.truth.channels["ids"], after.truth.channels["ids"])


def test_labels_beside_a_picture_are_those_that_the_channels_need(views: ViewCache) -> None:
    found = views.render(ViewRequest(PAPER, STATE, ("flow", "range"))).labels
    assert found is not None
    assert set(found) == {"range", "ids", "point"}


@pytest.mark.parametrize("surface", [PerPixel(), Tessellation(24, 12)], ids=str)
def test_labels_are_found_while_a_picture_with_the_rays_of_the_model_is_drawn(
    surface: MirrorSurface, views: ViewCache
) -> None:
    """Not beside a picture of a mirror mesh, whose rays are others."""
    spec = replace(PAPER, render_settings=RenderSettings(surface, samples=2))
    rendered = views.render(ViewRequest(spec, STATE, ("ids", "agreement")))
    labels = views.label(rendered, CameraChannel("Mine", "Omni"), 1.0)
    assert (rendered.labels is None) == isinstance(surface, Tessellation)
    assert labels.truth.channels["ids"].max() > 0
    if rendered.labels is not None:
        assert labels.truth.channels["ids"] is rendered.labels["ids"]
