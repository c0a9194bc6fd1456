"""Renderers that fail: made anew, replaced, or the view refused."""

from __future__ import annotations

from collections.abc import Mapping
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
from catoptra_server.effects.effect import (
    EMPTY_CONTEXT,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
    ImageEffect,
    SceneSummary,
)
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.plans import PlanChoice
from catoptra_server.frames.plan.renderers import RendererChoice, RendererPool
from catoptra_server.frames.views import ViewCache, ViewFailedError
from catoptra_server.render.renderer import NO_THRESHOLDS, RenderedImage, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState
from helpers.robots import CAMERA

CAMERA_STATE = CameraState(Pose.identity())


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
            image = effect.apply(image, cast(OmniCamera, self._camera), EMPTY_CONTEXT)
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
    rendered = renderers.views.render(ViewRequest(camera, CAMERA_STATE))
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
        rendered = renderers.views.render(ViewRequest(camera, CAMERA_STATE))
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
        renderers.views.render(ViewRequest(camera, CAMERA_STATE))
    assert renderers.views.render(
        ViewRequest(camera, CAMERA_STATE)
    ).frame_plan.plan_text.startswith("trace")


@BOTH_KINDS
@PLACES
def test_view_that_fails_on_all_renderers_leaves_the_first_one_working(
    camera: CameraSpec, place: str
) -> None:
    renderers = FaultyRenderers(*2 * (f"trace {place}",), f"raster {place}")
    with pytest.raises(ViewFailedError, match="trace and raster failed to render the view"):
        renderers.views.render(ViewRequest(camera, CAMERA_STATE))
    for other in (LENS, MIRROR):
        rendered = renderers.views.render(ViewRequest(other, CAMERA_STATE))
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
            renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE))
    assert renderers.log == ["create trace"]
    draw_mirror(renderers)


def draw_mirror(renderers: FaultyRenderers) -> None:
    """Draw a frame, by trace."""
    rendered = renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE))
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
            renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE))
        renderers.views.render(ViewRequest(LENS, CAMERA_STATE))
    renderers.views.render(ViewRequest(MIRROR, CAMERA_STATE))


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
            renderers.views.render(ViewRequest(camera, CAMERA_STATE))
        # A criterion is no renderer's fault: the renderer stays.
        assert (renderers.log == ["create trace"]) == is_decision
        draw_mirror(renderers)
