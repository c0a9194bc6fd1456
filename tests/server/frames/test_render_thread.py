"""Requests become frames in another thread; a failure pauses one channel alone."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Collection, Hashable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from types import SimpleNamespace
from unittest.mock import ANY

import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames import render_thread as render_thread_module
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Channel,
    Frame,
    FrameRequest,
    ViewRequest,
)
from catoptra_server.frames.frame_plan import ViewState
from catoptra_server.frames.multi_view import TileLayout, multi_view_layout
from catoptra_server.frames.plan.camera import (
    CameraSpec,
    CameraVariant,
    OmniCameraSpec,
    PerspectiveCameraSpec,
)
from catoptra_server.frames.render_thread import PlanFailure, RenderThread, render_frame
from catoptra_server.frames.views import RenderedView, ViewFailedError
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.world.objects import CameraState
from helpers.frame_requests import VIEW, make_request
from helpers.loopback import DEADLINE_S
from helpers.robots import CAMERA, FakeViewProvider


def view_by(camera: CameraSpec) -> ViewRequest:
    return ViewRequest(camera, CameraState(Pose.identity()))


class FrameStore:
    """Stores frames and rejections; stops the render thread after some of both."""

    def __init__(self, stop_after: int = -1) -> None:
        self.frames: list[Frame] = []
        self.rejections: list[tuple[Channel, str]] = []
        self.dropped: list[Channel] = []
        self.repeated: list[int] = []
        self.can_repeat = True
        self.clients: dict[Channel, set[Hashable] | None] = {}
        self.render_thread: RenderThread | None = None
        self._stop_after = stop_after

    def put(self, frame: Frame) -> None:
        self.frames.append(frame)
        self._count()

    def repeat(self, request: FrameRequest) -> bool:
        self.repeated.append(request.sequence)
        return self.can_repeat

    def fail_frame(self, channel: Channel, reason: str) -> None:
        self.rejections.append((channel, reason))
        self._count()

    def drop_frame(self, channel: Channel) -> None:
        self.dropped.append(channel)

    def find_clients(self, channel: Channel) -> set[Hashable] | None:
        return self.clients.get(channel, {channel})

    def _count(self) -> None:
        if len(self.frames) + len(self.rejections) == self._stop_after:
            assert self.render_thread is not None
            self.render_thread.stop()


def make_render_thread(
    stop_after: int = -1, *, is_lockstep: bool = False
) -> tuple[RenderThread, FrameStore]:
    store = FrameStore(stop_after)
    store.render_thread = RenderThread(store, is_lockstep=is_lockstep, monotonic=lambda: 0.0)
    return store.render_thread, store


def start_render_thread(render_thread: RenderThread, views: FakeViewProvider) -> threading.Thread:
    thread = threading.Thread(target=render_thread.run, args=(lambda: views, lambda: None))
    thread.start()
    return thread


def test_render_thread_renders_the_queued_requests_in_order() -> None:
    (render_thread, store), views = make_render_thread(stop_after=3), FakeViewProvider()
    for sequence in (1, 2, 3):
        render_thread.submit(make_request(VIEW, sequence=sequence))
    render_thread.run(lambda: views, lambda: None)
    assert [frame.sequence for frame in store.frames] == [1, 2, 3]
    assert views.view.is_closed


@pytest.mark.parametrize("can_repeat", [True, False])
def test_frame_that_shows_what_an_earlier_one_does_is_drawn_only_where_that_is_gone(
    can_repeat: bool,
) -> None:
    render_thread, store = make_render_thread(stop_after=1 if can_repeat else 2)
    store.can_repeat = can_repeat
    render_thread.submit(dataclasses.replace(make_request(VIEW, sequence=2), repeats=1))
    render_thread.submit(make_request(VIEW, sequence=3))
    render_thread.run(FakeViewProvider, lambda: None)
    assert store.repeated == [2]
    assert [frame.sequence for frame in store.frames] == ([3] if can_repeat else [2, 3])


def test_render_thread_when_stopped_cancels_what_waits() -> None:
    (render_thread, store), views = make_render_thread(stop_after=1), FakeViewProvider()
    with ThreadPoolExecutor() as pool:
        waits = [
            pool.submit(render_thread.submit_and_wait, make_request(VIEW, sequence=i))
            for i in (1, 2)
        ]
        render_thread.submit(make_request(VIEW, sequence=3))  # that nobody waits for
        render_thread.run(lambda: views, lambda: None)
        cancelled = [isinstance(wait.exception(DEADLINE_S), CancelledError) for wait in waits]
    # Whichever came first is rendered, and stops the thread.
    rendered = [frame.sequence for frame in store.frames]
    assert cancelled == [1 not in rendered, 2 not in rendered]
    assert len(rendered) == 1
    with pytest.raises(CancelledError):
        render_thread.submit_and_wait(make_request(VIEW))
    render_thread.submit(make_request(VIEW))


def test_request_when_waited_for_puts_the_frame_before_the_wait_ends() -> None:
    render_thread, store = make_render_thread()
    thread = start_render_thread(render_thread, FakeViewProvider())
    render_thread.submit_and_wait(make_request(VIEW))
    assert len(store.frames) == 1
    render_thread.stop()
    thread.join()


class _FailingViews(FakeViewProvider):
    """Views that raise for one camera."""

    num_attempts = 0

    def render(self, request: ViewRequest) -> RenderedView:
        if request is BROKEN:
            self.num_attempts += 1
            raise ValueError("the lamp is broken")
        return super().render(request)


BROKEN = view_by(PerspectiveCameraSpec(PerspectiveCamera(4, 3, 2.0)))
BROKEN_CHANNEL = CameraChannel("R", "Broken")


@pytest.mark.parametrize("is_lockstep", [False, True])
def test_channel_when_rendering_fails_is_rejected_and_others_go_on(
    is_lockstep: bool, caplog: pytest.LogCaptureFixture
) -> None:
    render_thread, store = make_render_thread(stop_after=4, is_lockstep=is_lockstep)
    broken = dataclasses.replace(make_request(BROKEN), channel=BROKEN_CHANNEL)
    views = _FailingViews()
    for request in (broken, make_request(VIEW), broken, make_request(VIEW, sequence=2)):
        render_thread.submit(request)
    render_thread.run(lambda: views, lambda: None)
    assert [channel for channel, _ in store.rejections] == [BROKEN_CHANNEL, BROKEN_CHANNEL]
    assert [frame.sequence for frame in store.frames] == [1, 2]
    # In real time a failing channel rests for a while; lockstep does not depend on the time.
    assert views.num_attempts == (2 if is_lockstep else 1)
    assert sum(bool(record.exc_info) for record in caplog.records) <= 1


class _RefusingViews(FakeViewProvider):
    def render(self, request: ViewRequest) -> RenderedView:
        raise ViewFailedError("neither renderer draws this camera")


def test_channel_when_its_view_is_refused_has_the_reason() -> None:
    render_thread, store = make_render_thread(stop_after=1)
    render_thread.submit(make_request(VIEW))
    render_thread.run(_RefusingViews, lambda: None)
    assert store.rejections == [(IMAGE_PORT, "neither renderer draws this camera")]


def test_requests_when_the_renderer_cannot_start_are_cancelled() -> None:
    render_thread, _ = make_render_thread()

    def refuse() -> FakeViewProvider:
        raise ValueError("no renderer today")

    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(render_thread.submit_and_wait, make_request(VIEW))
        with pytest.raises(ValueError, match="no renderer"):
            render_thread.run(refuse, lambda: None)
        assert isinstance(waiting.exception(DEADLINE_S), CancelledError)


SPEC = OmniCameraSpec(CAMERA.camera, CAMERA.render_settings)
PLANNED = ViewRequest(SPEC, VIEW.camera_state)


def query_plans(render_thread: RenderThread, *clients: str) -> list[ViewState | PlanFailure]:
    """Replies to plan queries; the last one stops the thread."""
    replies = list[ViewState | PlanFailure]()

    def reply(state: ViewState | PlanFailure) -> None:
        replies.append(state)
        if len(replies) == len(clients):
            render_thread.stop()

    for client in clients:
        render_thread.query_plan(client, PLANNED, reply)
    return replies


def test_plan_query_of_the_same_client_supersedes_the_older() -> None:
    render_thread, _ = make_render_thread()
    replies = query_plans(render_thread, "a", "b", "a")
    assert replies == [PlanFailure("superseded by a newer request")]
    render_thread.run(FakeViewProvider, lambda: None)
    assert [type(state) for state in replies] == [PlanFailure, ViewState, ViewState]
    assert isinstance(replies[-1], ViewState)
    assert replies[-1].median_ms == 12.5


def test_plan_query_without_a_renderer_fails_in_words() -> None:
    render_thread, _ = make_render_thread()
    replies = query_plans(render_thread, "a")
    render_thread.run(lambda: None, lambda: None)
    assert replies == [PlanFailure("this server has no camera")]


class _RaisingPlans(FakeViewProvider):
    def view_state(self, request: ViewRequest) -> ViewState:
        raise ZeroDivisionError("plan")


def test_plan_query_when_planning_raises_fails_in_words() -> None:
    render_thread, _ = make_render_thread()
    replies = query_plans(render_thread, "a")
    render_thread.run(_RaisingPlans, lambda: None)
    assert [type(state) for state in replies] == [PlanFailure]


def test_plans_do_not_keep_frames_waiting() -> None:
    render_thread, store = make_render_thread()
    order = list[str]()

    class _RecordingViews(FakeViewProvider):
        def render(self, request: ViewRequest) -> RenderedView:
            order.append("frame")
            return super().render(request)

    for sequence in (1, 2):
        render_thread.submit(make_request(VIEW, sequence=sequence))
    for client in range(4):
        render_thread.query_plan(client, PLANNED, lambda state: order.append("plan"))
    render_thread.query_plan("last", PLANNED, lambda state: render_thread.stop())
    render_thread.run(_RecordingViews, lambda: None)
    assert order == ["frame", "plan", "frame", "plan", "plan", "plan"]
    assert len(store.frames) == 2


def test_idle_thread_closes_idle_views(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render_thread_module, "_IDLE_S", 0.01)
    render_thread, _ = make_render_thread()

    class Views(FakeViewProvider):
        def close_idle(self) -> None:
            render_thread.stop()

    thread = start_render_thread(render_thread, Views())
    thread.join(DEADLINE_S)
    assert not thread.is_alive()


SLOW = view_by(PerspectiveCameraSpec(PerspectiveCamera(4, 3, 1.5)))


class _SlowViews(FakeViewProvider):
    """Views of which one takes a second of a clock that stands still otherwise."""

    now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def render(self, request: ViewRequest) -> RenderedView:
        self.now_s += 1.0 if request is SLOW else 0.01
        return super().render(request)


def test_long_frames_under_lockstep_wait_for_no_other_channel() -> None:
    views, store = _SlowViews(), FrameStore(stop_after=3)
    store.render_thread = RenderThread(store, is_lockstep=True, monotonic=views.monotonic)
    slow = dataclasses.replace(make_request(SLOW), channel=CameraChannel("R", ""))
    for sequence, request in enumerate((slow, make_request(VIEW), slow)):
        store.render_thread.submit(dataclasses.replace(request, sequence=sequence))
    thread = start_render_thread(store.render_thread, views)
    thread.join(DEADLINE_S)
    is_waiting = thread.is_alive()
    store.render_thread.stop()
    thread.join()
    assert not is_waiting
    assert [frame.sequence for frame in store.frames] == [0, 1, 2]


def draw(store: FrameStore, channels: Sequence[Channel]) -> list[Channel]:
    """Order in which frames are drawn that each take one second, or are dropped."""
    times = iter(range(1000))
    store.render_thread = RenderThread(store, monotonic=lambda: float(next(times)))
    for channel in channels:
        store.render_thread.submit(dataclasses.replace(make_request(VIEW), channel=channel))
    store.render_thread.run(FakeViewProvider, lambda: None)
    return [frame.channel for frame in store.frames]


VARIANTS: list[Channel] = [
    CameraChannel("R", "", CameraVariant(max_error_px=px)) for px in (1.0, 2.0, 3.0)
]


def test_client_pays_for_all_that_it_requests_by_whatever_names() -> None:
    store = FrameStore(stop_after=4)
    store.clients = {one: {"greedy"} for one in VARIANTS}
    # After the first variant the others wait behind the image port, whose client has used nothing.
    drawn = draw(store, [*VARIANTS, IMAGE_PORT])
    assert drawn == [VARIANTS[0], IMAGE_PORT, *VARIANTS[1:]]


def test_frame_of_several_clients_has_the_place_of_the_one_that_has_used_least() -> None:
    store = FrameStore(stop_after=4)
    store.clients = {one: {"greedy"} for one in VARIANTS} | {VARIANTS[2]: {"greedy", "modest"}}
    drawn = draw(store, [*VARIANTS, IMAGE_PORT])
    assert drawn == [VARIANTS[0], VARIANTS[2], IMAGE_PORT, VARIANTS[1]]


def test_frame_that_nobody_waits_for_is_not_drawn() -> None:
    store = FrameStore(stop_after=2)
    store.clients = {VARIANTS[0]: None}
    assert draw(store, VARIANTS) == VARIANTS[1:]
    assert store.dropped == VARIANTS[:1]


def find_attempts(times_s: Sequence[float], works_at: Collection[float] = ()) -> list[float]:
    """Times at which a requested channel is rendered; it fails except at some of them."""
    tried, remaining = list[float](), list(times_s)
    clock = SimpleNamespace(now_s=remaining.pop(0))

    class Views(FakeViewProvider):
        def render(self, request: ViewRequest) -> RenderedView:
            tried.append(clock.now_s)
            if clock.now_s not in works_at:
                raise ViewFailedError("broken")
            return super().render(request)

    class Sink:
        def put(self, frame: Frame) -> None:
            if remaining:
                clock.now_s = remaining.pop(0)
                render_thread.submit(make_request(VIEW))
            else:
                render_thread.stop()

        def repeat(self, request: FrameRequest) -> bool:
            raise AssertionError("each frame is new")

        def fail_frame(self, channel: Channel, reason: str) -> None:
            assert reason == "broken"
            self.put(ANY)

        def drop_frame(self, channel: Channel) -> None:
            raise AssertionError("somebody waits")

        def find_clients(self, channel: Channel) -> set[Hashable]:
            return {channel}

    render_thread = RenderThread(Sink(), monotonic=lambda: clock.now_s)
    render_thread.submit(make_request(VIEW))
    render_thread.run(Views, lambda: None)
    return tried


def test_channel_when_failing_is_paused_for_longer_and_longer() -> None:
    expected, during, now_s = [0.0], list[float](), 0.0
    for pause_s in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0):
        during.append(now_s + pause_s - 0.001)
        now_s += pause_s + 0.001
        expected.append(now_s)
    assert find_attempts(sorted([*expected, *during])) == expected


def test_channel_after_a_success_begins_anew() -> None:
    times_s = [0.0, 1.1, 3.2, 3.3, 4.4]
    assert find_attempts(times_s, works_at=[3.2]) == times_s


@pytest.mark.parametrize(("others", "attempts"), [(63, 64), (64, 66)])
def test_pauses_of_many_channels_are_limited(others: int, attempts: int) -> None:
    """The oldest of more than 64 is forgotten: its channel is tried again."""
    render_thread, store = make_render_thread(stop_after=others + 2)
    tried = list[ViewRequest]()

    class Views(FakeViewProvider):
        def render(self, request: ViewRequest) -> RenderedView:
            tried.append(request)
            raise ViewFailedError("no camera")

    for number in (*range(others + 1), 0):
        channel = CameraChannel("R", str(number))
        render_thread.submit(dataclasses.replace(make_request(VIEW), channel=channel))
    render_thread.run(Views, lambda: None)
    assert len(tried) == attempts
    assert len(store.rejections) == others + 2


def draw_frame(request: FrameRequest, views: FakeViewProvider | None) -> Frame:
    return render_frame(request, views, monotonic=lambda: 0.0)


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
    alone = draw_frame(make_request(VIEW), _DecidingViews())
    layout = multi_view_layout(2, 1, width_px=4, height_px=3)
    both = draw_frame(make_request(VIEW, VIEW, layout=layout), _DecidingViews())
    assert (alone.effect_decisions, both.effect_decisions) == ((BLOOMING,), ())


def test_frame_of_several_tiles_is_composed_and_its_times_are_sums() -> None:
    layout = multi_view_layout(2, 1, width_px=4, height_px=3)
    frame = draw_frame(make_request(VIEW, VIEW, layout=layout), FakeViewProvider())
    assert frame.rgb[0, :, 0].tolist() == [1, 1, 1, 1, 2, 2, 2, 2]
    assert frame.stage_ms == {"fake": 2.0}


def test_frame_with_an_unused_tile_is_black_there_and_renders_nothing() -> None:
    views, layout = FakeViewProvider(), multi_view_layout(2, 1, width_px=4, height_px=3)
    frame = draw_frame(make_request(None, VIEW, layout=layout), views)
    assert frame.rgb[0, :, 0].tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert len(views.view_requests) == 1


def test_frame_without_views_is_black() -> None:
    frame = draw_frame(make_request(VIEW), None)
    assert (frame.rgb.shape, frame.rgb.any(), frame.plan) == ((3, 4, 3), False, None)


def test_frame_when_the_view_provider_is_empty_is_rendered() -> None:
    class Unprepared(FakeViewProvider):
        def __len__(self) -> int:
            return 0

    assert draw_frame(make_request(VIEW), Unprepared()).rgb.any()


def test_frame_of_an_omni_camera_carries_the_bound_of_its_plan() -> None:
    view = view_by(OmniCameraSpec(CAMERA.camera, CAMERA.render_settings))
    layout = TileLayout(1, 1, 8, 6, 8, 6)
    frame = draw_frame(make_request(view, layout=layout), FakeViewProvider())
    assert frame.error_bounds is not None
    assert frame.error_bound_px == frame.error_bounds["outline_px"] > 0.0
    assert "rounding_px" in frame.error_bounds


def test_frame_when_one_view_has_no_bound_has_none() -> None:
    layout = multi_view_layout(2, 1, width_px=8, height_px=6)
    omni = view_by(OmniCameraSpec(CAMERA.camera, CAMERA.render_settings))
    perspective = view_by(PerspectiveCameraSpec(PerspectiveCamera(8, 6, 1.0)))
    frame = draw_frame(make_request(omni, perspective, layout=layout), FakeViewProvider())
    assert (frame.error_bounds, frame.error_bound_px) == (None, None)


def test_bounds_of_several_views_are_the_largest_of_each() -> None:
    specs = [OmniCameraSpec(CAMERA.camera, RenderSettings(samples=samples)) for samples in (4, 1)]
    layout = multi_view_layout(2, 1, width_px=8, height_px=6)
    views = FakeViewProvider()
    requests = [view_by(spec) for spec in specs]
    frame = draw_frame(make_request(*requests, layout=layout), views)
    coarse = views.error_bound(specs[1])
    assert coarse is not None
    assert frame.error_bounds == coarse.numbers_by_name()


def test_frame_with_a_reference_shows_the_difference_and_has_the_view_s_own_numbers() -> None:
    request = make_request(VIEW)
    composition = dataclasses.replace(request.composition, reference=VIEW)
    frame = draw_frame(dataclasses.replace(request, composition=composition), FakeViewProvider())
    # The fake view counts its frames in grey levels.
    assert frame.rgb[0, :, 0].tolist() == [1, 1, 1, 1, 1, 1, 1, 1]
    assert frame.difference is not None
    assert (frame.difference.max_levels, frame.difference.reference_plan) == (1, "fake plan")
    assert frame.stage_ms == {"fake": 1.0}
