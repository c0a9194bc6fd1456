"""Capture times: one frame in rendering a channel, intervals, channels apart."""

from __future__ import annotations

from catoptra_server.frames.capture_scheduler import CaptureScheduler
from catoptra_server.frames.frame_request import IMAGE_PORT, CameraChannel, Channel

OTHER = CameraChannel("R", "Rear")


def due_channels(reels: CaptureScheduler, time_s: float) -> list[Channel]:
    return [channel for channel, _ in reels.due_channels(time_s)]


def start_due_frames(
    reels: CaptureScheduler, time_s: float, *, interval_s: float = 0.0
) -> list[int]:
    return [
        reel.start_frame(time_s, interval_s=interval_s) for _, reel in reels.due_channels(time_s)
    ]


def test_channel_without_a_request_is_not_due() -> None:
    assert due_channels(CaptureScheduler(), 0.0) == []


def test_channel_when_requested_several_times_is_captured_once() -> None:
    reels = CaptureScheduler()
    for _ in range(3):
        reels.request_frame(IMAGE_PORT, 0)
    assert start_due_frames(reels, 0.0) == [1]
    assert due_channels(reels, 1.0) == []


def test_channel_when_requested_during_rendering_waits_for_the_frame() -> None:
    reels = CaptureScheduler()
    reels.request_frame(IMAGE_PORT, 0)
    start_due_frames(reels, 0.0)
    reels.request_frame(IMAGE_PORT, 1)
    assert due_channels(reels, 1.0) == []
    reels.finish_frame(IMAGE_PORT)
    assert due_channels(reels, 1.0) == [IMAGE_PORT]


def test_channel_when_a_newer_frame_is_rendering_captures_no_other() -> None:
    reels = CaptureScheduler()
    reels.request_frame(IMAGE_PORT, 0)
    start_due_frames(reels, 0.0)
    reels.request_frame(IMAGE_PORT, 0)
    reels.finish_frame(IMAGE_PORT)
    assert due_channels(reels, 1.0) == []


def test_channel_when_limited_is_due_after_the_interval() -> None:
    reels = CaptureScheduler()
    reels.request_frame(IMAGE_PORT, 0)
    start_due_frames(reels, 1.0, interval_s=0.1)
    reels.finish_frame(IMAGE_PORT)
    reels.request_frame(IMAGE_PORT, 1)
    assert due_channels(reels, 1.08) == []
    assert due_channels(reels, 1.1) == [IMAGE_PORT]


def test_channels_when_there_are_two_count_apart() -> None:
    reels = CaptureScheduler()
    reels.request_frame(IMAGE_PORT, 0)
    reels.request_frame(OTHER, 0)
    assert start_due_frames(reels, 0.0) == [1, 1]
    reels.finish_frame(OTHER)
    reels.request_frame(OTHER, 1)
    assert due_channels(reels, 0.0) == [OTHER]
    assert start_due_frames(reels, 0.0) == [2]
    assert reels.count_frames() == 3


def test_channel_when_removed_restarts_the_count_and_ignores_late_frames() -> None:
    reels = CaptureScheduler()
    reels.request_frame(OTHER, 0)
    start_due_frames(reels, 0.0)
    reels.remove(OTHER)
    reels.finish_frame(OTHER)
    reels.request_frame(OTHER, 5)
    assert start_due_frames(reels, 0.0) == [1]


def test_cameras_when_the_robot_is_removed_stay_only_while_requested() -> None:
    reels, front = CaptureScheduler(), CameraChannel("R", "Front")
    for channel in (OTHER, front, CameraChannel("S", "Rear"), IMAGE_PORT):
        reels.request_frame(channel, 0)
    start_due_frames(reels, 0.0)
    reels.finish_frame(front)
    reels.request_frame(front, 1)
    reels.remove_idle("R")
    assert reels.count_frames() == 3  # all but the one that nobody waits for
    assert due_channels(reels, 0.0) == [front]
