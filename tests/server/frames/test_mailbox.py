"""Capture times of channels, and the slot of the newest frame, fresh or requested."""

from __future__ import annotations

import asyncio
import dataclasses
import math

import numpy as np
import pytest

from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Frame,
    FrameRendered,
    FrameRequested,
)
from catoptra_server.frames.mailbox import (
    MAX_CHANNELS,
    TICK_S,
    CaptureScheduler,
    ChannelUnavailableError,
    Mailbox,
    Mailboxes,
)
from catoptra_server.frames.plan.camera import CameraVariant
from catoptra_server.simulation.events import SimulationEvent
from helpers.frame_requests import make_request

NOW_S = 1000.0


def frame(sequence: int, *, age_s: float = 0.0, drawn_s: float = 0.0) -> Frame:
    """Frame that was finished some time ago."""
    rgb = np.zeros((1, 1, 3), dtype=np.uint8)
    finished_s = NOW_S - age_s
    return Frame(sequence, 0.0, rgb, finished_s, finished_s, render_duration_s=drawn_s)


class RequestCounter:
    """Counts requests for a frame."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, newer_than: float) -> None:
        self.count += 1
        self.newer_than = newer_than


def make_mailbox(*, prefetch: bool = True) -> tuple[Mailbox, RequestCounter]:
    """A mailbox of the running loop, and the counter of its requests."""
    requests = RequestCounter()
    return Mailbox(requests, prefetch=prefetch, monotonic=lambda: NOW_S), requests


async def let_it_wait(task: asyncio.Task[Frame]) -> None:
    """Run a task up to its first wait."""
    await asyncio.sleep(0)
    assert not task.done()


async def test_frame_when_missing_is_requested_and_waited_for() -> None:
    mailbox, requests = make_mailbox()
    task = asyncio.create_task(mailbox.wait_for_newer(0))
    await let_it_wait(task)
    assert requests.count == 1
    mailbox.put(frame(1))
    assert (await task).sequence == 1
    assert requests.count == 2  # the next one, ahead


@pytest.mark.parametrize(
    ("waiting", "last", "taken"),
    [
        (frame(5, drawn_s=1e9), 4, True),
        (frame(5, drawn_s=1e9), 5, False),
        (frame(5, age_s=10.0, drawn_s=1.0), 4, False),
        (frame(5, age_s=0.0, drawn_s=1e-6), 4, True),  # younger than a tick: the same world
    ],
    ids=["young and new", "known already", "older than drawing takes", "younger than a tick"],
)
async def test_stored_frame_when_prefetching_is_served_if_fresh_and_new(
    waiting: Frame, last: int, taken: bool
) -> None:
    mailbox, _ = make_mailbox()
    mailbox.put(waiting)
    await asyncio.sleep(0)
    task = asyncio.create_task(mailbox.wait_for_newer(last))
    await asyncio.sleep(0)
    assert task.done() is taken
    mailbox.put(frame(6))
    assert (await task).sequence == (5 if taken else 6)


async def test_stored_frame_under_lockstep_is_never_served() -> None:
    mailbox, requests = make_mailbox(prefetch=False)
    mailbox.put(frame(5, drawn_s=1e9))
    await asyncio.sleep(0)
    task = asyncio.create_task(mailbox.wait_for_newer(0))
    await let_it_wait(task)
    mailbox.put(frame(6))
    assert (await task).sequence == 6
    assert requests.count == 1  # nothing ahead: time stands still


async def test_frames_when_several_arrive_leave_the_newest() -> None:
    mailbox, _ = make_mailbox()
    for sequence in (1, 2, 3):
        mailbox.put(frame(sequence, drawn_s=1e9))
    await asyncio.sleep(0)
    assert (await mailbox.wait_for_newer(0)).sequence == 3


async def test_waiting_task_when_cancelled_leaves_the_others_waiting() -> None:
    mailbox, _ = make_mailbox()
    gone, stays = (asyncio.create_task(mailbox.wait_for_newer(0)) for _ in range(2))
    await let_it_wait(stays)
    gone.cancel()
    await let_it_wait(stays)
    assert mailbox.wants_next
    mailbox.put(frame(1))
    assert (await stays).sequence == 1
    assert gone.cancelled()


async def test_mailbox_whose_last_waiting_task_is_cancelled_is_awaited_by_nobody() -> None:
    mailbox, _ = make_mailbox()
    task = asyncio.create_task(mailbox.wait_for_newer(0))
    await let_it_wait(task)
    assert mailbox.wants_next
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert not mailbox.wants_next


async def test_frame_when_several_wait_is_requested_once() -> None:
    mailbox, requests = make_mailbox()
    mailbox.put(frame(7, drawn_s=1e9))
    assert (await mailbox.wait_for_newer(6)).sequence == 7
    assert requests.newer_than == 7  # the next one, ahead
    task = asyncio.create_task(mailbox.wait_for_newer(7))
    await let_it_wait(task)
    assert requests.newer_than == 7  # the same one again: it is drawn only once
    mailbox.put(frame(8))
    assert (await task).sequence == 8


async def test_frame_when_one_coroutine_cancels_another_reaches_the_rest() -> None:
    mailbox, _ = make_mailbox()

    async def wait_and_cancel() -> None:
        await mailbox.wait_for_newer(0)
        cancelled.cancel()

    first = asyncio.create_task(wait_and_cancel())
    await let_it_wait(first)
    cancelled, last = (asyncio.create_task(mailbox.wait_for_newer(0)) for _ in range(2))
    await let_it_wait(last)
    asyncio.get_running_loop().call_soon(mailbox.put, frame(1))
    assert (await last).sequence == 1
    await first
    await asyncio.gather(cancelled, return_exceptions=True)
    assert cancelled.cancelled()


async def test_mailboxes_when_a_channel_existed_before_request_any_frame() -> None:
    posted: list[SimulationEvent] = []
    boxes = Mailboxes(posted.append, prefetch=False)
    waiting = asyncio.create_task(boxes.get(IMAGE_PORT).wait_for_newer(0))
    other = asyncio.create_task(boxes.get(IMAGE_PORT).wait_for_newer(0))
    await let_it_wait(waiting)
    assert posted == [FrameRequested(math.inf, IMAGE_PORT)]  # once, for both
    boxes.put(frame(38))
    assert (await waiting).sequence == (await other).sequence == 38
    assert posted[1:] == [FrameRendered(IMAGE_PORT)]


@pytest.mark.parametrize("prefetch", [True, False])
async def test_frame_that_is_awaited_when_put_has_the_next_one_requested_at_once(
    prefetch: bool,
) -> None:
    posted: list[SimulationEvent] = []
    boxes = Mailboxes(posted.append, prefetch=prefetch)
    tasks = [asyncio.create_task(boxes.get(IMAGE_PORT).wait_for_newer(0)) for _ in range(3)]
    await let_it_wait(tasks[-1])
    boxes.put(frame(1))
    # Before any coroutine is resumed, and by none of them again.
    expected = [FrameRendered(IMAGE_PORT), *[FrameRequested(1, IMAGE_PORT)][:prefetch]]
    assert posted[1:] == expected
    await asyncio.gather(*tasks)
    assert posted[1:] == expected


async def test_frame_that_nobody_awaits_when_put_has_no_other_requested() -> None:
    posted: list[SimulationEvent] = []
    boxes = Mailboxes(posted.append, prefetch=True)
    held = boxes.get(IMAGE_PORT)
    boxes.put(frame(1))
    await asyncio.sleep(0)
    assert posted == [FrameRendered(IMAGE_PORT)]
    # A client that begins to wait between frame and delivery has the next one requested.
    waiting = asyncio.create_task(held.wait_for_newer(1))
    await let_it_wait(waiting)
    assert posted[1:] == [FrameRequested(1, IMAGE_PORT)]
    boxes.put(frame(2))
    assert (await waiting).sequence == 2


@pytest.mark.parametrize("prefetch", [True, False])
async def test_clients_of_a_frame_are_those_that_wait_or_would_request_it_next(
    prefetch: bool,
) -> None:
    boxes = Mailboxes(lambda event: None, prefetch=prefetch)
    assert boxes.find_clients(IMAGE_PORT) is None
    held = boxes.get(IMAGE_PORT)
    tasks = [asyncio.create_task(held.wait_for_newer(0, client)) for client in "ab"]
    await let_it_wait(tasks[-1])
    assert boxes.find_clients(IMAGE_PORT) == {"a", "b"}
    tasks[0].cancel()
    await asyncio.gather(tasks[0], return_exceptions=True)
    assert boxes.find_clients(IMAGE_PORT) == {"b"}
    boxes.put(frame(1))
    await tasks[1]
    # The next one is drawn ahead for the client that receives this one.
    assert boxes.find_clients(IMAGE_PORT) == ({"b"} if prefetch else None)
    del held, tasks
    assert boxes.find_clients(IMAGE_PORT) is None


async def test_frame_that_was_not_drawn_is_requested_again_for_who_waits_since() -> None:
    posted: list[SimulationEvent] = []
    boxes = Mailboxes(posted.append, prefetch=True)
    waiting = asyncio.create_task(boxes.get(IMAGE_PORT).wait_for_newer(0))
    await let_it_wait(waiting)
    boxes.drop_frame(IMAGE_PORT)
    await asyncio.sleep(0)
    assert posted[1:] == [FrameRendered(IMAGE_PORT), FrameRequested(math.inf, IMAGE_PORT)]
    boxes.put(frame(1))
    assert (await waiting).sequence == 1


async def test_frame_that_is_repeated_has_a_new_number_and_times_and_the_same_payloads() -> None:
    boxes = Mailboxes(lambda request: None, prefetch=True)
    mailbox, first = boxes.get(IMAGE_PORT), frame(1)
    request = dataclasses.replace(make_request(sequence=2), repeats=1)
    assert not boxes.repeat(request)  # of a channel without a frame
    boxes.put(first)
    await asyncio.sleep(0)
    waiting = asyncio.create_task(mailbox.wait_for_newer(1))
    await let_it_wait(waiting)
    assert boxes.repeat(request)
    second = await waiting
    assert (second.sequence, second.time_s, second.exposed_at_s) == (2, 0.5, 2.0)
    assert second.rgb is first.rgb
    assert await second.encode(ImageType.RAW) is await first.encode(ImageType.RAW)
    assert not boxes.repeat(request)  # the newest is another one


async def test_channel_that_restarts_its_count_is_requested_again() -> None:
    mailbox, requests = make_mailbox()
    mailbox.put(frame(9), is_next_requested=True)
    for number in (1, 2):  # frames of another robot under the old name
        task = asyncio.create_task(mailbox.wait_for_newer(9))
        await let_it_wait(task)
        assert requests.count == number - 1
        mailbox.put(frame(number))
        assert (await task).sequence == number
        assert requests.newer_than == number


async def test_mailboxes_when_a_channel_fails_raise_for_that_channel_alone() -> None:
    boxes = Mailboxes(lambda request: None, prefetch=False)
    lost, kept = CameraChannel("Gone", ""), IMAGE_PORT
    waiting = asyncio.create_task(boxes.get(lost).wait_for_newer(0))
    other = asyncio.create_task(boxes.get(kept).wait_for_newer(0))
    await let_it_wait(waiting)
    boxes.fail(lost, "")
    with pytest.raises(ChannelUnavailableError):
        await waiting
    boxes.put(frame(1))
    assert (await other).sequence == 1


async def test_mailbox_without_a_reference_is_freed() -> None:
    boxes = Mailboxes(lambda request: None, prefetch=False)
    held = boxes.get(IMAGE_PORT)
    assert boxes.get(IMAGE_PORT) is held
    boxes.get(CameraChannel("R", ""))
    assert len(boxes) == 1


async def test_variant_of_a_camera_is_never_requested_ahead() -> None:
    posted: list[SimulationEvent] = []
    boxes = Mailboxes(posted.append, prefetch=True)
    channel = CameraChannel("R", "Omni", CameraVariant(samples=1))
    task = asyncio.create_task(boxes.get(channel).wait_for_newer(0))
    await let_it_wait(task)
    boxes.put(dataclasses.replace(frame(1), channel=channel))
    assert (await task).sequence == 1
    assert posted == [FrameRequested(math.inf, channel), FrameRendered(channel)]


OTHER = CameraChannel("R", "Rear")


def start_due_frames(
    scheduler: CaptureScheduler, time_s: float, *, interval_s: float = 0.0
) -> list[int]:
    return [
        scheduler.find_state(channel).start_frame(time_s, interval_s=interval_s)
        for channel in scheduler.due_channels(time_s)
    ]


def test_channel_when_requested_several_times_is_captured_once() -> None:
    scheduler = CaptureScheduler()
    for _ in range(3):
        scheduler.request_frame(IMAGE_PORT, 0)
    assert start_due_frames(scheduler, 0.0) == [1]
    assert scheduler.due_channels(1.0) == []


def test_channel_when_requested_during_rendering_waits_for_the_frame() -> None:
    scheduler = CaptureScheduler()
    scheduler.request_frame(IMAGE_PORT, 0)
    start_due_frames(scheduler, 0.0)
    scheduler.request_frame(IMAGE_PORT, 1)
    assert scheduler.due_channels(1.0) == []
    state = scheduler.finish_frame(IMAGE_PORT)
    assert state is not None
    assert state.is_requested
    assert scheduler.due_channels(1.0) == [IMAGE_PORT]


def test_channel_when_a_newer_frame_is_rendering_captures_no_other() -> None:
    scheduler = CaptureScheduler()
    scheduler.request_frame(IMAGE_PORT, 0)
    start_due_frames(scheduler, 0.0)
    scheduler.request_frame(IMAGE_PORT, 0)
    scheduler.finish_frame(IMAGE_PORT)
    assert scheduler.due_channels(1.0) == []


def test_channel_when_limited_is_due_after_the_interval() -> None:
    scheduler = CaptureScheduler()
    scheduler.request_frame(IMAGE_PORT, 0)
    start_due_frames(scheduler, 1.0, interval_s=0.1)
    scheduler.finish_frame(IMAGE_PORT)
    scheduler.request_frame(IMAGE_PORT, 1)
    assert scheduler.due_channels(1.08) == []
    assert scheduler.due_channels(1.1) == [IMAGE_PORT]


def test_channels_when_there_are_two_count_apart() -> None:
    scheduler = CaptureScheduler()
    scheduler.request_frame(IMAGE_PORT, 0)
    scheduler.request_frame(OTHER, 0)
    assert start_due_frames(scheduler, 0.0) == [1, 1]
    scheduler.finish_frame(OTHER)
    scheduler.request_frame(OTHER, 1)
    assert scheduler.due_channels(0.0) == [OTHER]
    assert start_due_frames(scheduler, 0.0) == [2]
    assert scheduler.count_frames() == 3


def test_channel_when_removed_restarts_the_count_and_ignores_late_frames() -> None:
    scheduler = CaptureScheduler()
    scheduler.request_frame(OTHER, 0)
    start_due_frames(scheduler, 0.0)
    scheduler.remove(OTHER)
    assert scheduler.finish_frame(OTHER) is None
    scheduler.request_frame(OTHER, 5)
    assert start_due_frames(scheduler, 0.0) == [1]


def test_cameras_when_the_robot_is_removed_stay_only_while_requested() -> None:
    scheduler, front = CaptureScheduler(), CameraChannel("R", "Front")
    for channel in (OTHER, front, CameraChannel("S", "Rear"), IMAGE_PORT):
        scheduler.request_frame(channel, 0)
    start_due_frames(scheduler, 0.0)
    scheduler.finish_frame(front)
    scheduler.request_frame(front, 1)
    scheduler.remove_idle("R")
    assert scheduler.count_frames() == 3  # all but the one that nobody waits for
    assert scheduler.due_channels(0.0) == [front]


def test_channels_without_a_request_are_removed_where_there_are_too_many() -> None:
    scheduler = CaptureScheduler()
    scheduler.request_frame(IMAGE_PORT, 0)
    for number in range(2 * MAX_CHANNELS):
        channel = CameraChannel("R", str(number))
        scheduler.request_frame(channel, 0)
        scheduler.find_state(channel).start_frame(0.0, interval_s=0.0)
        scheduler.finish_frame(channel)
    assert IMAGE_PORT in scheduler.due_channels(1.0)
    assert scheduler.count_frames() < MAX_CHANNELS


def test_interval_that_is_no_multiple_of_a_tick_holds_on_average() -> None:
    scheduler, times = CaptureScheduler(), []
    for tick in range(100):
        scheduler.request_frame(IMAGE_PORT, 1e9)
        if start_due_frames(scheduler, tick * TICK_S, interval_s=0.05):
            times.append(tick * TICK_S)
            scheduler.finish_frame(IMAGE_PORT)
    assert len(times) == 40
    assert times[:5] == pytest.approx([0.0, 0.06, 0.1, 0.16, 0.2])


def test_interval_after_a_pause_begins_anew() -> None:
    scheduler = CaptureScheduler()
    for time_s in (0.0, 7.0):
        scheduler.request_frame(IMAGE_PORT, 1e9)
        assert start_due_frames(scheduler, time_s, interval_s=0.05) != []
        scheduler.finish_frame(IMAGE_PORT)
    scheduler.request_frame(IMAGE_PORT, 1e9)
    assert scheduler.due_channels(7.04) == []
    assert scheduler.due_channels(7.06) == [IMAGE_PORT]
