"""Requests become frames in another thread: in order, composed; a failure ends one channel."""

from __future__ import annotations

import dataclasses
import threading
from concurrent.futures import CancelledError, ThreadPoolExecutor

import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Channel,
    Frame,
    FrameComposition,
    FrameMetadata,
    FrameRequest,
    ViewRequest,
)
from catoptra_server.frames.frame_plan import ViewState
from catoptra_server.frames.plan.camera import CameraVariant, OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.frames.render_thread import PlanFailure, RenderThread
from catoptra_server.frames.views import RenderedView, ViewFailedError
from catoptra_server.world.camera_state import CameraState
from helpers.frame_requests import SINGLE, VIEW, make_request
from helpers.loopback import DEADLINE_S
from helpers.robots import CAMERA, FakeViewProvider


class FrameStore:
    """Stores frames and rejections; stops the render thread after some of both."""

    def __init__(self, stop_after: int = -1) -> None:
        self.frames: list[Frame] = []
        self.rejections: list[tuple[Channel, str]] = []
        self.render_thread: RenderThread | None = None
        self._stop_after = stop_after

    def put(self, frame: Frame) -> None:
        self.frames.append(frame)
        self._count()

    def fail_frame(self, channel: Channel, reason: str) -> None:
        self.rejections.append((channel, reason))
        self._count()

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


BROKEN = ViewRequest(
    PerspectiveCameraSpec(PerspectiveCamera(4, 3, 2.0)), CameraState(Pose.identity())
)
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


def query_plans(render_thread: RenderThread, *clients: str) -> list[ViewState | PlanFailure]:
    """Replies to plan queries; the last one stops the thread."""
    replies = list[ViewState | PlanFailure]()

    def reply(state: ViewState | PlanFailure) -> None:
        replies.append(state)
        if len(replies) == len(clients):
            render_thread.stop()

    for client in clients:
        render_thread.query_plan(client, SPEC, reply)
    return replies


def test_plan_query_is_answered_by_the_render_thread() -> None:
    render_thread, _ = make_render_thread()
    replies = query_plans(render_thread, "a")
    render_thread.run(FakeViewProvider, lambda: None)
    assert [isinstance(state, ViewState) and state.median_ms for state in replies] == [12.5]


def test_plan_query_of_the_same_client_supersedes_the_older() -> None:
    render_thread, _ = make_render_thread()
    replies = query_plans(render_thread, "a", "b", "a")
    assert replies == [PlanFailure("superseded by a newer request")]
    render_thread.run(FakeViewProvider, lambda: None)
    assert [type(state) for state in replies] == [PlanFailure, ViewState, ViewState]


def test_plan_query_without_a_renderer_fails_in_words() -> None:
    render_thread, _ = make_render_thread()
    replies = query_plans(render_thread, "a")
    render_thread.run(lambda: None, lambda: None)
    assert replies == [PlanFailure("this server has no camera")]


class _RaisingPlans(FakeViewProvider):
    def view_state(self, camera: OmniCameraSpec) -> ViewState:
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
        render_thread.query_plan(client, SPEC, lambda state: order.append("plan"))
    render_thread.query_plan("last", SPEC, lambda state: render_thread.stop())
    render_thread.run(_RecordingViews, lambda: None)
    assert order == ["frame", "plan", "frame", "plan", "plan", "plan"]
    assert len(store.frames) == 2


SLOW = ViewRequest(
    PerspectiveCameraSpec(PerspectiveCamera(4, 3, 1.5)), CameraState(Pose.identity())
)


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


def test_variants_of_all_cameras_share_one_account() -> None:
    (render_thread, store), views = make_render_thread(stop_after=4), FakeViewProvider()
    variants = [CameraChannel("R", "", CameraVariant(max_error_px=px)) for px in (1.0, 2.0, 3.0)]
    channels: list[Channel] = [*variants, IMAGE_PORT]
    # The clock stands still: every frame is long for the queue's purposes only by its charge.
    times = iter(range(1000))
    render_thread = RenderThread(store, monotonic=lambda: float(next(times)))
    store.render_thread = render_thread
    for channel in channels:
        render_thread.submit(dataclasses.replace(make_request(VIEW), channel=channel))
    render_thread.run(lambda: views, lambda: None)
    # After the first variant the others wait behind the image port, which has used nothing.
    assert [frame.channel for frame in store.frames] == [variants[0], IMAGE_PORT, *variants[1:]]


def test_channels_of_one_camera_share_one_account() -> None:
    times = iter(range(1000))
    store, views = FrameStore(stop_after=4), FakeViewProvider()
    store.render_thread = RenderThread(store, monotonic=lambda: float(next(times)))
    # An empty name selects the displayed robot, or its first camera: here the same one.
    names = [("", "omni"), ("R", ""), ("R", "omni"), ("R", "front")]
    channels = [CameraChannel(robot, camera) for robot, camera in names]
    for channel in channels:
        metadata = FrameMetadata("R", camera="Front" if channel.camera == "front" else "Omni")
        composition = FrameComposition(SINGLE, (VIEW,), metadata)
        store.render_thread.submit(FrameRequest(channel, 1, 0.5, 2.0, composition))
    store.render_thread.run(lambda: views, lambda: None)
    # After the first frame of one camera its others wait behind the other camera.
    assert [frame.channel for frame in store.frames] == [channels[0], channels[3], *channels[1:3]]
