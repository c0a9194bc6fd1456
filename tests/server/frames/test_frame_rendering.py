"""Frames composed of one view or several, with their times, bounds and decisions."""

from __future__ import annotations

import dataclasses

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import (
    ViewRequest,
)
from catoptra_server.frames.multi_view import TileLayout, multi_view_layout
from catoptra_server.frames.plan.camera import OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.render_thread import max_bounds, render_frame
from catoptra_server.frames.views import RenderedView
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.world.camera_state import CameraState
from helpers.frame_requests import VIEW, make_request
from helpers.robots import CAMERA, FakeViewProvider

BLOOMING = EffectDecision("Blooming", False, 0.0, 0.5, "dim")


def test_frame_of_one_tile_is_the_view_s_image() -> None:
    frame = render_frame(make_request(VIEW), FakeViewProvider(), monotonic=lambda: 3.0)
    assert frame.rgb.shape == (3, 4, 3)
    assert (frame.time_s, frame.exposed_at_s, frame.finished_at_s) == (0.5, 2.0, 3.0)
    assert (frame.plan, frame.stage_ms) == ("fake plan", {"fake": 1.0})


class _DecidingViews(FakeViewProvider):
    def render(self, request: ViewRequest) -> RenderedView:
        return dataclasses.replace(super().render(request), effect_decisions=(BLOOMING,))


def test_frame_of_one_camera_has_its_decisions_and_of_several_none() -> None:
    alone = render_frame(make_request(VIEW), _DecidingViews(), monotonic=lambda: 0.0)
    layout = multi_view_layout(2, 1, width_px=4, height_px=3)
    both = render_frame(
        make_request(VIEW, VIEW, layout=layout), _DecidingViews(), monotonic=lambda: 0.0
    )
    assert (alone.effect_decisions, both.effect_decisions) == ((BLOOMING,), ())


def test_frame_of_several_tiles_is_composed_and_its_times_are_sums() -> None:
    layout = multi_view_layout(2, 1, width_px=4, height_px=3)
    frame = render_frame(
        make_request(VIEW, VIEW, layout=layout), FakeViewProvider(), monotonic=lambda: 0.0
    )
    assert frame.rgb[0, :, 0].tolist() == [1, 1, 1, 1, 2, 2, 2, 2]
    assert frame.stage_ms == {"fake": 2.0}


def test_frame_with_an_unused_tile_is_black_there_and_renders_nothing() -> None:
    views, layout = FakeViewProvider(), multi_view_layout(2, 1, width_px=4, height_px=3)
    frame = render_frame(make_request(None, VIEW, layout=layout), views, monotonic=lambda: 0.0)
    assert frame.rgb[0, :, 0].tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert len(views.view_requests) == 1


def test_frame_without_views_is_black() -> None:
    frame = render_frame(make_request(VIEW), None, monotonic=lambda: 0.0)
    assert (frame.rgb.shape, frame.rgb.any(), frame.plan) == ((3, 4, 3), False, None)


def test_frame_when_the_view_provider_is_empty_is_rendered() -> None:
    class Unprepared(FakeViewProvider):
        def __len__(self) -> int:
            return 0

    assert render_frame(make_request(VIEW), Unprepared(), monotonic=lambda: 0.0).rgb.any()


def test_frame_of_an_omni_camera_carries_the_bound_of_its_plan() -> None:
    view = ViewRequest(
        OmniCameraSpec(CAMERA.camera, CAMERA.render_settings), CameraState(Pose.identity())
    )
    layout = TileLayout(1, 1, 8, 6, 8, 6)
    frame = render_frame(
        make_request(view, layout=layout), FakeViewProvider(), monotonic=lambda: 0.0
    )
    assert frame.error_bounds is not None
    assert frame.error_bound_px == frame.error_bounds["outline_px"] > 0.0
    assert "rounding_px" in frame.error_bounds


def test_frame_when_one_view_has_no_bound_has_none() -> None:
    layout = multi_view_layout(2, 1, width_px=8, height_px=6)
    omni = ViewRequest(
        OmniCameraSpec(CAMERA.camera, CAMERA.render_settings), CameraState(Pose.identity())
    )
    perspective = ViewRequest(
        PerspectiveCameraSpec(PerspectiveCamera(8, 6, 1.0)), CameraState(Pose.identity())
    )
    frame = render_frame(
        make_request(omni, perspective, layout=layout), FakeViewProvider(), monotonic=lambda: 0.0
    )
    assert (frame.error_bounds, frame.error_bound_px) == (None, None)


def test_bounds_of_several_views_are_the_largest_of_each() -> None:
    plans = (RenderSettings(samples=1), RenderSettings(samples=4))
    views = FakeViewProvider()
    one, four = (views.error_bound(OmniCameraSpec(CAMERA.camera, settings)) for settings in plans)
    assert one is not None
    assert four is not None
    assert max_bounds([four.as_dict(), one.as_dict()]) == one.as_dict()


def test_frame_with_a_reference_shows_the_difference_and_has_the_view_s_own_numbers() -> None:
    request = make_request(VIEW)
    composition = dataclasses.replace(request.composition, reference=VIEW)
    frame = render_frame(
        dataclasses.replace(request, composition=composition),
        FakeViewProvider(),
        monotonic=lambda: 0.0,
    )
    # The fake view counts its frames in grey levels.
    assert frame.rgb[0, :, 0].tolist() == [1, 1, 1, 1, 1, 1, 1, 1]
    assert frame.difference is not None
    assert (frame.difference.max_levels, frame.difference.reference_plan) == (1, "fake plan")
    assert frame.stage_ms == {"fake": 1.0}
