"""Shots become frames in another thread: in order, composed, and nobody waits for what failed."""

from __future__ import annotations

import dataclasses
import threading
from concurrent.futures import CancelledError

import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.effects.decide import Decision
from catoptra_server.imaging.drawing import Drawing, developed, worst
from catoptra_server.imaging.frame import Frame
from catoptra_server.imaging.multi_view import TileLayout, multi_view
from catoptra_server.imaging.shot import SCREEN, OmniEye, Scenery, Shot, Take
from catoptra_server.imaging.views import ViewState
from catoptra_server.render.renderer import Exposure, RenderedImage
from catoptra_server.robot.render_wish import RenderWish
from helpers.robots import CAMERA, FakeView, FakeViews

TAKE = Take(PerspectiveCamera(4, 3, 1.0), Exposure(Pose.identity()))
BLOOM = Decision("Bloom", False, 0.0, 0.5, "grey levels", "dim")
SINGLE = TileLayout(1, 1, 4, 3, 4, 3)


def shot_of(*takes: Take | None, layout: TileLayout = SINGLE, sequence: int = 1) -> Shot:
    return Shot(SCREEN, sequence, 0.5, 2.0, Scenery(layout, takes))


class _Broken(FakeView):
    def draw(self, exposure: Exposure) -> RenderedImage:
        raise ValueError("the lamp is broken")


def drawing_thread(drawing: Drawing, views: FakeViews) -> threading.Thread:
    def main() -> None:
        try:
            drawing.run(lambda: views, lambda: None)
        except ValueError:
            pass  # the server's worker hands it on

    thread = threading.Thread(target=main)
    thread.start()
    return thread


def test_frame_when_of_one_tile_is_the_picture_itself() -> None:
    frame = developed(shot_of(TAKE), FakeViews(), monotonic=lambda: 3.0)
    assert frame.rgb.shape == (3, 4, 3)
    assert (frame.time_s, frame.exposed_s, frame.finished_s) == (0.5, 2.0, 3.0)
    assert (frame.plan, frame.stage_ms) == ("fake plan", {"fake": 1.0})


class _Deciding(FakeViews):
    def draw(self, take: Take) -> RenderedImage:
        return dataclasses.replace(super().draw(take), effects=(BLOOM,))


def test_frame_when_of_one_camera_tells_its_effects_and_of_several_none() -> None:
    alone = developed(shot_of(TAKE), _Deciding(), monotonic=lambda: 0.0)
    layout = multi_view(2, 1, width_px=4, height_px=3)
    both = developed(shot_of(TAKE, TAKE, layout=layout), _Deciding(), monotonic=lambda: 0.0)
    assert (alone.effects, both.effects) == ((BLOOM,), ())


def test_frame_when_of_several_tiles_is_composed_and_its_times_are_sums() -> None:
    layout = multi_view(2, 1, width_px=4, height_px=3)
    frame = developed(shot_of(TAKE, TAKE, layout=layout), FakeViews(), monotonic=lambda: 0.0)
    assert frame.rgb[0, :, 0].tolist() == [1, 1, 1, 1, 2, 2, 2, 2]
    assert frame.stage_ms == {"fake": 2.0}


def test_frame_when_a_tile_is_nobody_s_is_black_there_and_draws_nothing() -> None:
    views, layout = FakeViews(), multi_view(2, 1, width_px=4, height_px=3)
    frame = developed(shot_of(None, TAKE, layout=layout), views, monotonic=lambda: 0.0)
    assert frame.rgb[0, :, 0].tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert len(views.takes) == 1


def test_frame_when_there_are_no_views_is_black() -> None:
    frame = developed(shot_of(TAKE), None, monotonic=lambda: 0.0)
    assert (frame.rgb.shape, frame.rgb.any(), frame.plan) == ((3, 4, 3), False, None)


def test_drawing_when_told_to_stop_first_draws_what_was_handed_over() -> None:
    frames = list[Frame]()
    drawing, views = Drawing(frames.append), FakeViews()
    for sequence in (1, 2, 3):
        drawing.draw(shot_of(TAKE, sequence=sequence))
    drawing.stop()
    drawing_thread(drawing, views).join()
    assert [frame.sequence for frame in frames] == [1, 2, 3]
    assert views.view.closed


def test_shot_when_waited_for_is_put_before_the_wait_ends() -> None:
    frames = list[Frame]()
    drawing = Drawing(frames.append)
    thread = drawing_thread(drawing, FakeViews())
    drawing.draw_and_wait(shot_of(TAKE))
    assert len(frames) == 1
    drawing.stop()
    thread.join()


def test_shot_when_drawing_fails_raises_that_and_later_ones_are_cancelled() -> None:
    drawing, views = Drawing(lambda frame: None), FakeViews(_Broken())
    thread = drawing_thread(drawing, views)
    with pytest.raises(ValueError, match="the lamp is broken"):
        drawing.draw_and_wait(shot_of(TAKE))
    thread.join()
    with pytest.raises(CancelledError):
        drawing.draw_and_wait(shot_of(TAKE))
    assert views.view.closed


def test_shots_when_drawing_never_began_are_cancelled() -> None:
    drawing = Drawing(lambda frame: None)
    waiting = drawing.draw(shot_of(TAKE))

    def refuse() -> FakeViews:
        raise ValueError("no renderer today")

    with pytest.raises(ValueError, match="no renderer"):
        drawing.run(refuse, lambda: None)
    assert waiting.cancelled()


def test_frame_when_no_view_is_prepared_yet_is_drawn_all_the_same() -> None:
    class Unprepared(FakeViews):
        def __len__(self) -> int:
            return 0

    assert developed(shot_of(TAKE), Unprepared(), monotonic=lambda: 0.0).rgb.any()


def test_frame_when_of_an_omnidirectional_camera_carries_the_bound_of_its_plan() -> None:
    take = Take(OmniEye(CAMERA.camera, CAMERA.wish), Exposure(Pose.identity()))
    layout = TileLayout(1, 1, 8, 6, 8, 6)
    frame = developed(shot_of(take, layout=layout), FakeViews(), monotonic=lambda: 0.0)
    assert frame.bound is not None
    assert frame.error_bound_px == frame.bound["outline_px"] > 0.0
    assert "rounding_px" in frame.bound


def test_frame_when_one_of_its_pictures_has_no_bound_has_none() -> None:
    layout = multi_view(2, 1, width_px=8, height_px=6)
    omni = Take(OmniEye(CAMERA.camera, CAMERA.wish), Exposure(Pose.identity()))
    flat = Take(PerspectiveCamera(8, 6, 1.0), Exposure(Pose.identity()))
    frame = developed(shot_of(omni, flat, layout=layout), FakeViews(), monotonic=lambda: 0.0)
    assert (frame.bound, frame.error_bound_px) == (None, None)


def test_bound_of_several_pictures_is_the_worst_of_each() -> None:
    plans = (RenderWish(samples=1), RenderWish(samples=4))
    views = FakeViews()
    one, four = (views.bound(OmniEye(CAMERA.camera, wish)) for wish in plans)
    assert one is not None
    assert worst([four, one]) == one.as_dict()


def test_question_when_asked_is_answered_by_the_drawing_thread() -> None:
    drawing, told = Drawing(lambda frame: None), list[ViewState | None]()
    drawing.ask(OmniEye(CAMERA.camera, CAMERA.wish), told.append)
    drawing.stop()
    drawing_thread(drawing, FakeViews()).join()
    assert [state and state.median_ms for state in told] == [12.5]


def test_question_when_nothing_is_drawn_here_is_answered_by_nothing() -> None:
    drawing, told = Drawing(lambda frame: None), list[ViewState | None]()
    drawing.ask(OmniEye(CAMERA.camera, CAMERA.wish), told.append)
    drawing.stop()
    drawing.run(lambda: None, lambda: None)
    assert told == [None]
