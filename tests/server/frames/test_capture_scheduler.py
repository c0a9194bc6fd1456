"""Capture times: one frame in rendering a channel, intervals, channels apart."""

from __future__ import annotations

import pytest

from catoptra_server.frames.frame import IMAGE_PORT, CameraChannel
from catoptra_server.frames.mailbox import MAX_CHANNELS, TICK_S, CaptureScheduler

OTHER = CameraChannel("R", "Rear")


def start_due_frames(
    scheduler: CaptureScheduler, time_s: float, *, interval_s: float = 0.0
) -> list[int]:
    return [
        scheduler.find_state(channel).start_frame(time_s, interval_s=interval_s)
        for channel in scheduler.due_channels(time_s)
    ]


def test_channel_without_a_request_is_not_due() -> None:
    assert CaptureScheduler().due_channels(0.0) == []


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
