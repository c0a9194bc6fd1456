"""Prepared views share memory by camera and plan, and are closed by the memory they hold."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.frames import views as view_store
from catoptra_server.frames.frame_plan import CameraPlan
from catoptra_server.frames.plan.camera import OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.planner import BudgetMonitor
from catoptra_server.frames.plan.plans import plan_from_settings, plan_perspective_view
from catoptra_server.frames.plan.renderers import RendererChoice, RendererPool, create_renderer
from catoptra_server.frames.views import ViewStore
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer import Renderer, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import make_effect
from helpers.opengl import device_or_skip
from helpers.worlds import make_omni_camera, make_test_world

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
CAMERA = make_omni_camera(width_px=100)
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
    plan = plan_from_settings(settings, CAMERA, kind=TRACE, reason=reason)
    spec = OmniCameraSpec(CAMERA, settings, effects)
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
        view = renderer.prepare(CAMERA, cast(RenderPlan, plan))
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
    view = renderer.prepare(CAMERA, cast(RenderPlan, plan))
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
