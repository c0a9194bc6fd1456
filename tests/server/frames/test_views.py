"""Prepared views share memory by camera and plan, and are closed by the memory they hold.

Renderers that fail: made anew, replaced, or the view refused.

Labels of frames: flow to the channel's last frame, limits, rays that are closed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.bounds.coordinate_rounding import CoordinateErrors
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect import (
    NO_EFFECT_SETTINGS,
    CaptureContext,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
    ImageEffect,
    SceneSummary,
)
from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.frames import views as view_store
from catoptra_server.frames.frame import CameraChannel, ViewRequest
from catoptra_server.frames.frame_plan import CameraPlan
from catoptra_server.frames.labels.labels import DrawnExposure
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.planner import BudgetMonitor, RenderPlanner
from catoptra_server.frames.plan.plans import PlanChoice, plan_from_settings, plan_perspective_view
from catoptra_server.frames.plan.renderers import (
    RendererChoice,
    RendererPool,
    choose_renderer,
    create_renderer,
)
from catoptra_server.frames.views import FrameLabeller, ViewCache, ViewFailedError, ViewStore
from catoptra_server.render.render_settings import (
    MirrorSurface,
    PerPixel,
    RenderSettings,
    Tessellation,
)
from catoptra_server.render.renderer import NO_THRESHOLDS, RenderedImage, Renderer, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import make_effect
from helpers.labelled_rooms import CAMERAS, SCENE, STATE, WORLD
from helpers.opengl import device_or_skip
from helpers.robots import CAMERA
from helpers.worlds import make_omni_camera, make_test_world

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
CAMERA_VIEW_STORE = make_omni_camera(width_px=100)
CAMERA_STATE = CameraState(Pose.from_rpy((0.0, 0.0, -0.6)))


class SizedView:
    """A view of a size that a test sets."""

    def __init__(self, memory_bytes: int, closed: list[int]) -> None:
        self.memory_bytes, self._closed = memory_bytes, closed

    def close(self) -> None:
        self._closed.append(self.memory_bytes)


class SizedRenderer:
    """Prepares views of as many bytes as a frame has samples along a pixel's side."""

    def __init__(self) -> None:
        self.closed: list[int] = []
        self.num_prepared = 0

    def prepare(self, camera: object, plan: RenderPlan) -> SizedView:
        self.num_prepared += 1
        return SizedView(plan.samples, self.closed)

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> SizedView:
        self.num_prepared += 1
        return SizedView(camera.width_px, self.closed)


def make_store(renderer: Any, **limits: int) -> ViewStore:
    return ViewStore(RendererPool(RendererChoice(renderer, TRACE, "test")), **limits)


def plan_camera(
    samples: int, *, reason: str = "test", effects: EffectSettings = NO_EFFECT_SETTINGS
) -> CameraPlan:
    settings = RenderSettings(samples=samples)
    plan = plan_from_settings(settings, CAMERA_VIEW_STORE, kind=TRACE, reason=reason)
    spec = OmniCameraSpec(CAMERA_VIEW_STORE, settings, effects)
    return CameraPlan(spec, plan, BudgetMonitor(0.0))


def test_cameras_of_one_plan_share_a_view_whatever_target_and_effects_they_have() -> None:
    renderer = SizedRenderer()
    store = make_store(renderer)
    one = store.get(plan_camera(2).view_key)
    assert store.get(plan_camera(2, reason="another").view_key) is one
    assert store.get(plan_camera(2, effects=EffectSettings(threshold_px=0.1)).view_key) is one
    assert store.get(plan_camera(3).view_key) is not one
    assert renderer.num_prepared == len(store) == 2


def use(store: ViewStore, *samples: int) -> None:
    for number in samples:
        store.get(plan_camera(number).view_key)
        store.trim()


def test_view_that_was_closed_is_prepared_anew_although_it_was_used_last() -> None:
    renderer = SizedRenderer()
    store, planned = make_store(renderer), plan_camera(2)
    one = store.get(planned.view_key)
    assert store.get(planned.view_key) is one
    store.close_views_of(TRACE)
    assert store.get(planned.view_key) is not one
    assert renderer.num_prepared == 2


def test_views_used_longest_ago_are_closed_beyond_the_memory_limit() -> None:
    renderer = SizedRenderer()
    store = make_store(renderer, max_bytes=9)
    use(store, 2, 3, 4, 2, 5)
    assert renderer.closed == [3, 4]
    assert store.memory_bytes == 7


def test_view_that_is_larger_than_the_limit_is_kept_alone() -> None:
    renderer = SizedRenderer()
    store = make_store(renderer, max_bytes=6)
    use(store, 2, 3, 8)
    assert (renderer.closed, len(store)) == ([2, 3], 1)
    use(store, 8)
    assert renderer.num_prepared == 3


def test_view_that_grows_when_it_is_used_counts_with_its_new_size() -> None:
    renderer = SizedRenderer()
    store = make_store(renderer, max_bytes=9)
    use(store, 2, 3)
    cast(SizedView, store.get(plan_camera(3).view_key)).memory_bytes = 8
    store.trim()
    assert renderer.closed == [2]


def test_view_that_grew_while_it_was_alone_counts_with_its_new_size() -> None:
    renderer = SizedRenderer()
    store = make_store(renderer, max_bytes=9)
    use(store, 2)
    cast(SizedView, store.get(plan_camera(2).view_key)).memory_bytes = 8
    use(store, 2, 3)
    assert (renderer.closed, store.memory_bytes) == ([8], 3)


def test_views_are_limited_in_number_too() -> None:
    renderer = SizedRenderer()
    store = make_store(renderer, max_views=2)
    use(store, 2, 3, 4)
    assert renderer.closed == [2]


def test_views_of_a_renderer_are_closed_together_and_a_failing_one_stops_nothing() -> None:
    renderer = SizedRenderer()
    store = make_store(renderer)
    use(store, 2, 3)
    lens = PerspectiveCameraSpec(PerspectiveCamera(20, 10, 1.0))
    plan = plan_perspective_view(0, kind=TRACE, reason="test")
    view = store.get(CameraPlan(lens, plan, BudgetMonitor(0.0)).view_key)

    def fail() -> None:
        raise RuntimeError("lost device")

    cast(Any, view).close = fail
    store.close_views_of(RASTER)
    assert len(store) == 3
    store.close_views_of(TRACE)
    assert (renderer.closed, len(store)) == ([2, 3], 0)


def test_freed_memory_is_given_back_once_enough_was_prepared_and_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    releases: list[int] = []
    monkeypatch.setattr(view_store, "release_freed_memory", lambda: releases.append(1))
    monkeypatch.setattr(view_store, "_RELEASE_BYTES", 5)
    store = make_store(SizedRenderer(), max_bytes=6)
    counts = []
    for samples in (2, 2, 3, 3, 4, 4):
        use(store, samples)
        counts.append(len(releases))
    # 2 and 3 bytes prepared; 4 prepared and 2 + 3 closed for them; frames alone change nothing.
    assert counts == [0, 0, 1, 1, 2, 2]
    store.close_views_of(TRACE)
    store.trim()
    assert len(releases) == 2, "4 bytes closed are not enough"


def create_or_skip(kind: RendererKind) -> Renderer:
    if kind is RASTER:
        device_or_skip().close()
    world = make_test_world()
    return create_renderer(kind, build_scene(world), world)


@pytest.mark.parametrize("kind", list(RendererKind))
def test_view_states_the_size_of_its_rays_or_images(kind: RendererKind) -> None:
    renderer = create_or_skip(kind)
    sizes = []
    for samples in (1, 2, 4):
        plan = replace(plan_camera(samples).plan, renderer=kind)
        view = renderer.prepare(CAMERA_VIEW_STORE, cast(RenderPlan, plan))
        view.render(CAMERA_STATE)
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
    plan = replace(plan_camera(1).plan, renderer=kind)
    view = renderer.prepare(CAMERA_VIEW_STORE, cast(RenderPlan, plan))
    view.render(CAMERA_STATE)
    before = view.memory_bytes
    view.render(CAMERA_STATE, (make_effect("DefocusByDepth"),))
    # Ranges of all pixels, a texel of 4 bytes at least; rays that are traced have them already.
    assert view.memory_bytes - before > (0 if kind is TRACE else 100 * 100 * 4) - 1
    view.close()
    lens = renderer.prepare_perspective(PerspectiveCamera(100, 50, 1.0), 2)
    assert lens.memory_bytes > 100 * 50 * 4 * 8
    lens.close()
    renderer.close()


CAMERA_STATE_RENDERER_RECOVERY = CameraState(Pose.identity())


class DarkScene:
    """Bounds of a dark scene."""

    def max_rounding_angle_rad(self, camera_state: CameraState, errors: CoordinateErrors) -> float:
        return 1e-6

    def summarize_radiance(self, camera_state: CameraState) -> SceneSummary:
        return SceneSummary(0.1)

    def summarize(self, camera_state: CameraState, camera: OmniCamera) -> SceneSummary:
        return self.summarize_radiance(camera_state)


class InjectedError(Exception):
    """A fault of a renderer, not an error that Catoptra raises."""


class FaultyRenderer:
    """Renders black; raises in places that a test names, as often as the test says."""

    def __init__(self, faults: list[str], log: list[str], name: str) -> None:
        self._faults, self._log, self._name = faults, log, name
        self._log.append(f"create {name}")

    def describe(self) -> str:
        return self._name

    def raise_at(self, place: str) -> None:
        if f"{self._name} {place}" in self._faults:
            self._faults.remove(f"{self._name} {place}")
            raise InjectedError(place)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        self.raise_at("prepare")
        return FaultyView(self, camera)

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> Any:
        self.raise_at("prepare")
        return FaultyView(self, camera)

    def close(self) -> None:
        self._log.append(f"close {self._name}")
        self.raise_at("close")


class FaultyView:
    memory_bytes = 1

    def __init__(self, renderer: FaultyRenderer, camera: OmniCamera | PerspectiveCamera) -> None:
        self._renderer, self._camera = renderer, camera

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
    ) -> RenderedImage:
        self._renderer.raise_at("render")
        height, width = self._camera.height_px, self._camera.width_px
        image = np.zeros((height, width, 3), dtype=np.float32)
        for effect in effects:
            image = effect.apply(image, cast(OmniCamera, self._camera), CaptureContext())
        return RenderedImage(image.astype(np.uint8), {})

    def close(self) -> None:
        self._renderer.raise_at("close view")


class FaultyRenderers:
    """Views of a trace renderer with raster as its alternative, both faulty on demand."""

    def __init__(self, *faults: str, may_replace: bool = True, named: bool = False) -> None:
        self.faults, self.log = list[str](), list[str]()
        create = {kind: partial(self._create, kind.value) for kind in RendererKind}
        choice = RendererChoice(
            create[RendererKind.TRACE](),
            RendererKind.TRACE,
            "test",
            {RendererKind.TRACE: create[RendererKind.TRACE]} if named else create,
        )
        self.views = ViewCache(
            RenderPlanner(RendererPool(choice, may_replace=may_replace)),
            cast(Any, DarkScene()),
        )
        self.faults.extend(faults)

    def _create(self, name: str) -> Any:
        if f"{name} create" in self.faults:
            self.faults.remove(f"{name} create")
            raise InjectedError("create")
        return FaultyRenderer(self.faults, self.log, name)


LENS, MIRROR = (
    PerspectiveCameraSpec(PerspectiveCamera(20, 10, 1.0)),
    OmniCameraSpec(CAMERA.camera, CAMERA.render_settings),
)
BOTH_KINDS = pytest.mark.parametrize("camera", [LENS, MIRROR], ids=["lens", "mirror"])
PLACES = pytest.mark.parametrize("place", ["prepare", "render"])


@BOTH_KINDS
@PLACES
def test_renderer_that_raises_once_is_made_anew_and_renders_the_frame(
    camera: CameraSpec, place: str, caplog: pytest.LogCaptureFixture
) -> None:
    renderers = FaultyRenderers(f"trace {place}", "trace close", "trace close view")
    rendered = renderers.views.render(ViewRequest(camera, CAMERA_STATE_RENDERER_RECOVERY))
    assert rendered.frame_plan.plan_text.startswith("trace")
    assert "failed" not in rendered.frame_plan.plan_text
    assert renderers.log == ["create trace", "close trace", "create trace"]
    assert "trace failed to render a view and is made anew" in caplog.text


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
    renderers = FaultyRenderers(*faults)
    for _ in range(2):
        rendered = renderers.views.render(ViewRequest(camera, CAMERA_STATE_RENDERER_RECOVERY))
        assert rendered.frame_plan.plan_text.startswith("raster")
        assert "raster in place of trace, which failed" in rendered.frame_plan.plan_text
    assert renderers.faults == []
    assert renderers.log[-1] == "create raster"


@BOTH_KINDS
@PLACES
@pytest.mark.parametrize("settings", [{"may_replace": False}, {"named": True}], ids=str)
def test_view_is_refused_under_lockstep_and_by_a_named_renderer(
    camera: CameraSpec, place: str, settings: dict[str, bool]
) -> None:
    renderers = FaultyRenderers(*2 * (f"trace {place}",), **settings)
    with pytest.raises(ViewFailedError, match="trace failed to render the view: see the server"):
        renderers.views.render(ViewRequest(camera, CAMERA_STATE_RENDERER_RECOVERY))
    assert renderers.views.render(
        ViewRequest(camera, CAMERA_STATE_RENDERER_RECOVERY)
    ).frame_plan.plan_text.startswith("trace")


@BOTH_KINDS
@PLACES
def test_view_that_fails_on_all_renderers_leaves_the_first_one_working(
    camera: CameraSpec, place: str
) -> None:
    renderers = FaultyRenderers(*2 * (f"trace {place}",), f"raster {place}")
    with pytest.raises(ViewFailedError, match="trace and raster failed to render the view"):
        renderers.views.render(ViewRequest(camera, CAMERA_STATE_RENDERER_RECOVERY))
    for other in (LENS, MIRROR):
        rendered = renderers.views.render(ViewRequest(other, CAMERA_STATE_RENDERER_RECOVERY))
        assert rendered.frame_plan.plan_text.startswith("trace")
        assert "failed" not in rendered.frame_plan.plan_text


@PLACES
def test_view_that_no_renderer_could_draw_is_refused_without_a_new_renderer(place: str) -> None:
    renderers = FaultyRenderers()

    def refuse(*_: object) -> None:
        raise DomainError("too many samples")

    target = FaultyRenderer if place == "prepare" else FaultyView
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(target, place, refuse)
        with pytest.raises(ViewFailedError, match="too many samples"):
            renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE_RENDERER_RECOVERY))
    assert renderers.log == ["create trace"]
    draw_mirror(renderers)


def draw_mirror(renderers: FaultyRenderers) -> None:
    """Draw a frame, by trace."""
    rendered = renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE_RENDERER_RECOVERY))
    assert rendered.frame_plan.plan_text.startswith("trace")


def test_planning_that_raises_refuses_the_view_and_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    renderers = FaultyRenderers()

    def fail(*_: object) -> PlanChoice:
        raise InjectedError

    with monkeypatch.context() as patch:
        patch.setattr(RenderPlanner, "choose_plan", fail)
        with pytest.raises(ViewFailedError, match="could not be decided"):
            renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE_RENDERER_RECOVERY))
        renderers.views.render(ViewRequest(LENS, CAMERA_STATE_RENDERER_RECOVERY))
    renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE_RENDERER_RECOVERY))


def test_view_prepared_ahead_is_prepared_by_a_new_renderer_after_a_fault() -> None:
    renderers = FaultyRenderers("trace prepare")
    assert "test" in renderers.views.prepare(MIRROR)
    assert len(renderers.views) == 1


@pytest.mark.parametrize("type_", EFFECT_TYPES, ids=lambda type_: type_.name)
@pytest.mark.parametrize("place", ["bound", "apply"])
def test_effect_that_raises_refuses_its_view_and_no_other(
    type_: EffectType, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    effect = type_.factory(**{each.field: each.default for each in type_.parameters})
    method = "apply_to_scene" if place == "apply" and effect.changes_scene else place
    settings = EffectSettings((EffectSetting(effect, EffectMode.ALWAYS),))
    camera = replace(MIRROR, effect_settings=settings)
    renderers = FaultyRenderers()

    def fail(*_: object) -> None:
        raise InjectedError(type_.name)

    with monkeypatch.context() as patch:
        patch.setattr(type(effect), method, fail)
        is_decision = place == "bound" or effect.changes_scene
        reason = (
            "could not be decided .*InjectedError" if is_decision else "trace and raster failed"
        )
        with pytest.raises(ViewFailedError, match=reason):
            renderers.views.render(ViewRequest(camera, CAMERA_STATE_RENDERER_RECOVERY))
        # A criterion is no renderer's fault: the renderer stays.
        assert (renderers.log == ["create trace"]) == is_decision
        draw_mirror(renderers)


CHANNEL = CameraChannel("Mine", "Omni")
DRAWN = DrawnExposure(CAMERAS["paper"], STATE)
LATER = replace(STATE, world_from_mirror=Pose.from_rpy((0.35, 0.17, -0.6), (0.02, -0.03, 0.3)))


@pytest.fixture(scope="module")
def pool() -> Iterator[RendererPool]:
    found = RendererPool(choose_renderer("trace", SCENE, WORLD, threads=1))
    yield found
    found.close()


@pytest.fixture
def labeller(pool: RendererPool) -> Iterator[FrameLabeller]:
    found = FrameLabeller(pool, SceneSummarizer(SCENE, WORLD))
    yield found
    found.close()


def test_flow_leads_to_the_last_frame_of_the_same_channel(labeller: FrameLabeller) -> None:
    first = labeller.label(DRAWN, ("flow",), CHANNEL, 1.0)
    other = labeller.label(DRAWN, ("flow",), CameraChannel("Other", "Omni"), 1.5)
    second = labeller.label(replace(DRAWN, camera_state=LATER), ("flow",), CHANNEL, 2.0)
    assert (first.flow_to_time_s, other.flow_to_time_s) == (None, None)
    assert np.isnan(first.truth.channels["flow"]).all()
    assert second.flow_to_time_s == 1.0
    assert np.nanmax(np.abs(second.truth.channels["flow"])) > 0.5


def test_frames_without_flow_are_not_remembered(labeller: FrameLabeller) -> None:
    labeller.label(DRAWN, ("ids",), CHANNEL, 1.0)
    assert labeller.label(DRAWN, ("flow",), CHANNEL, 2.0).flow_to_time_s is None


def test_displaced_camera_is_reported(labeller: FrameLabeller) -> None:
    displaced = replace(DRAWN, image_effects=(Misalignment(x_m=0.002),))
    assert labeller.label(displaced, ("ids",), CHANNEL, 1.0).is_displaced
    assert not labeller.label(DRAWN, ("ids",), CHANNEL, 1.0).is_displaced


def test_labels_of_a_huge_image_are_rejected(labeller: FrameLabeller) -> None:
    huge = replace(DRAWN, camera=replace(CAMERAS["fish-eye"], width_px=4096, height_px=4096))
    with pytest.raises(ViewFailedError, match="4096 x 4096 px take 192 MiB, more than 64"):
        labeller.label(huge, ("point",), CHANNEL, 1.0)


def test_labeller_goes_on_after_its_rays_were_closed(labeller: FrameLabeller) -> None:
    before = labeller.label(DRAWN, ("ids",), CHANNEL, 1.0)
    labeller.close()
    after = labeller.label(DRAWN, ("ids",), CHANNEL, 1.0)
    np.testing.assert_array_equal(before.truth.channels["ids"], after.truth.channels["ids"])


def test_request_beside_a_picture_names_what_the_channels_need(labeller: FrameLabeller) -> None:
    found = labeller.request(DRAWN, ("flow", "range"))
    assert found is not None
    assert found.channels == {"flow", "range", "ids", "point"}
    assert found.centres.samples == 1


def test_request_that_cannot_be_answered_leaves_the_picture_alone(labeller: FrameLabeller) -> None:
    huge = replace(DRAWN, camera=replace(CAMERAS["fish-eye"], width_px=4096, height_px=4096))
    assert labeller.request(huge, ("point",)) is None


@pytest.mark.parametrize("surface", [PerPixel(), Tessellation(24, 12)], ids=str)
def test_labels_are_found_while_a_picture_with_the_rays_of_the_model_is_drawn(
    surface: MirrorSurface,
) -> None:
    """Not beside a picture of a mirror mesh, whose rays are others."""
    spec = OmniCameraSpec(CAMERAS["paper"], RenderSettings(surface, samples=2))
    choice = choose_renderer("trace", SCENE, WORLD, threads=1)
    views = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(SCENE, WORLD))
    try:
        request = ViewRequest(spec, STATE, partial(views.request_labels, ("ids", "agreement")))
        rendered = views.render(request)
        labels = views.label(rendered, ("ids", "agreement"), CHANNEL, 1.0)
        assert (rendered.labels is None) == isinstance(surface, Tessellation)
        assert labels.truth.channels["ids"].max() > 0
        if rendered.labels is not None:
            assert labels.truth.channels["ids"] is rendered.labels["ids"]
    finally:
        views.close()
