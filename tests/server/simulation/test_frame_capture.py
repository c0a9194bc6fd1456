"""Frames captured by any thread from compositions that hold, and by the simulation otherwise."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Carrier,
    Channel,
    FrameComposition,
    FrameRequest,
    FrameRequested,
)
from catoptra_server.frames.mailbox import TICK_S
from catoptra_server.simulation.frame_capture import FrameCapture
from catoptra_server.world.world_description import AT_REST, Twist
from helpers.frame_requests import SINGLE, VIEW

OTHER = CameraChannel("R", "Rear")
GONE = CameraChannel("nobody", "")
FORWARD = Twist((1.0, 0.0, 0.0))


class Captures:
    """A capture of frames of a moving robot, and everything that it has called."""

    def __init__(
        self, *, is_realtime: bool = True, interval_s: float = 0.0, twist: Twist = FORWARD
    ) -> None:
        self.now_s = 7.0
        self.view = replace(VIEW, carrier=Carrier(Pose.identity(), twist, Pose.identity()))
        self.composed: list[Channel] = []
        self.frames: list[FrameRequest] = []
        self.rejected: list[tuple[Channel, str]] = []
        self.composes = True
        self.capture = FrameCapture(
            self._compose,
            render=self.frames.append,
            reject=lambda *rejection: self.rejected.append(rejection),
            is_realtime=is_realtime,
            image_port_interval_s=interval_s,
            monotonic=lambda: self.now_s,
        )

    def _compose(self, channel: Channel) -> FrameComposition | None:
        self.composed.append(channel)
        if not self.composes:
            raise ZeroDivisionError("composition")
        return None if channel == GONE else FrameComposition(SINGLE, (self.view,))

    def capture_one(self, channel: Channel = IMAGE_PORT) -> None:
        """Capture a frame in the simulation thread, and finish it."""
        self.capture.request_frame(FrameRequested(math.inf, channel))
        self.capture.capture_due_channels()
        assert self.capture.finish_frame(channel) is None


def test_frame_without_a_composition_is_left_to_the_simulation() -> None:
    captures = Captures()
    request = FrameRequested(0)
    assert not captures.capture.capture_at_once(request)
    captures.capture.capture_due_channels()
    assert captures.frames == []  # nothing was recorded
    captures.capture.request_frame(request)
    captures.capture.capture_due_channels()
    assert [(f.channel, f.sequence, f.exposed_at_s) for f in captures.frames] == [
        (IMAGE_PORT, 1, 7.0)
    ]


def test_frames_of_one_composition_are_of_the_instants_of_their_exposures() -> None:
    captures = Captures()
    captures.capture.begin_tick(1.0, 7.0)
    captures.capture_one()
    for sequence in (1, 2):
        captures.now_s += 0.005
        assert captures.capture.capture_at_once(FrameRequested(sequence))
        assert captures.capture.finish_frame(IMAGE_PORT) is None
    assert captures.composed == [IMAGE_PORT]
    assert captures.capture.count_frames() == 3
    assert [frame.sequence for frame in captures.frames] == [1, 2, 3]
    assert [frame.time_s for frame in captures.frames] == pytest.approx([0.98, 0.985, 0.99])
    views = [frame.composition.views[0] for frame in captures.frames]
    x_m = [view.camera_state.world_from_mirror.translation[0] for view in views if view]
    assert x_m == pytest.approx([-0.02, -0.015, -0.01])


def test_frame_of_a_late_tick_shows_the_tick() -> None:
    captures = Captures()
    captures.capture.begin_tick(1.0, 7.0 - 2 * TICK_S)
    captures.capture_one()
    assert (captures.frames[0].time_s, captures.frames[0].composition.views) == (
        1.0,
        (captures.view,),
    )
    # Until the next tick nothing else can be shown.
    assert captures.capture.capture_at_once(FrameRequested(1))
    assert len(captures.frames) == 1


def test_frame_of_what_stands_is_repeated_once_a_tick() -> None:
    captures = Captures(twist=AT_REST)
    captures.capture_one()
    assert captures.capture.capture_at_once(FrameRequested(1))
    captures.capture.capture_due_channels()
    assert len(captures.frames) == 1
    for tick in (1, 2):
        captures.capture.begin_tick(tick * TICK_S)
        captures.capture_one()
    assert [(f.sequence, f.repeats) for f in captures.frames] == [(1, None), (2, 1), (3, 2)]


def test_frame_of_what_stands_is_drawn_at_once_after_a_change() -> None:
    captures = Captures(twist=AT_REST)
    captures.capture_one()
    assert captures.capture.capture_at_once(FrameRequested(1))
    turned = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    state = replace(captures.view.camera_state, world_from_mirror=turned)
    captures.view = replace(captures.view, camera_state=state)
    captures.capture.invalidate()
    captures.capture.capture_due_channels()
    assert [frame.repeats for frame in captures.frames] == [None, None]


def test_frame_under_lockstep_is_drawn_for_each_request() -> None:
    captures = Captures(is_realtime=False, twist=AT_REST)
    for _ in range(2):
        captures.capture_one()
    assert [frame.repeats for frame in captures.frames] == [None, None]


def test_frame_after_a_change_is_composed_anew() -> None:
    for change in (lambda c: c.invalidate(), lambda c: c.begin_tick(0.02)):
        captures = Captures()
        captures.capture_one()
        change(captures.capture)
        assert not captures.capture.capture_at_once(FrameRequested(1))
        captures.capture.request_frame(FrameRequested(1))
        captures.capture.capture_due_channels()
        assert captures.composed == [IMAGE_PORT, IMAGE_PORT]


def test_frame_in_rendering_serves_older_requests_and_delays_newer_ones() -> None:
    captures = Captures()
    captures.capture.begin_tick(0.0, 7.0)
    captures.capture.request_frame(FrameRequested(0))
    captures.capture.capture_due_channels()
    assert captures.capture.capture_at_once(FrameRequested(0))
    assert captures.capture.finish_frame(IMAGE_PORT) is None
    captures.now_s += 0.001
    assert captures.capture.capture_at_once(FrameRequested(1))
    # One in rendering: the next is due when it is finished, also without a composition.
    captures.capture.begin_tick(0.02, 7.02)
    assert captures.capture.capture_at_once(FrameRequested(2))
    waiting = captures.capture.finish_frame(IMAGE_PORT)
    assert waiting == FrameRequested(2, IMAGE_PORT)
    assert not captures.capture.capture_at_once(waiting)
    assert [frame.sequence for frame in captures.frames] == [1, 2]


def test_frame_of_a_limited_channel_waits_for_its_interval_without_the_simulation() -> None:
    captures = Captures(interval_s=0.1)
    captures.capture_one()
    assert captures.capture.capture_at_once(FrameRequested(1))
    captures.capture.begin_tick(0.08)
    assert captures.capture.capture_at_once(FrameRequested(1))
    captures.capture.capture_due_channels()
    assert len(captures.frames) == 1
    captures.capture.begin_tick(0.1)
    captures.capture.capture_due_channels()
    assert [frame.time_s for frame in captures.frames] == [0.0, 0.1]
    unlimited = Captures(interval_s=0.1, is_realtime=False)
    unlimited.capture_one()
    assert unlimited.capture.capture_at_once(FrameRequested(1))
    assert len(unlimited.frames) == 2


def test_channel_that_captures_in_every_tick_is_composed_ahead() -> None:
    captures = Captures()
    for tick in range(3):
        captures.capture.begin_tick(0.02 * tick)
        captures.capture.capture_due_channels()
        captures.capture_one()
    assert len(captures.composed) == 3
    captures.capture.begin_tick(0.06)
    captures.capture.capture_due_channels()
    assert len(captures.composed) == 4
    assert captures.capture.capture_at_once(FrameRequested(3))
    # Composed once more, since the last tick had a frame, and then no more.
    for tick in range(4, 8):
        captures.capture.begin_tick(0.02 * tick)
        captures.capture.capture_due_channels()
    assert len(captures.composed) == 5


def test_channel_when_it_cannot_be_composed_is_rejected_with_the_reason() -> None:
    captures = Captures()
    captures.capture.request_frame(FrameRequested(0, GONE))
    captures.capture.capture_due_channels()
    captures.composes = False
    captures.capture.request_frame(FrameRequested(0, OTHER))
    captures.capture.capture_due_channels()
    assert [(channel, bool(reason)) for channel, reason in captures.rejected] == [
        (GONE, False),
        (OTHER, True),
    ]
    assert captures.frames == []
    assert captures.capture.finish_frame(OTHER) is None  # of a channel that is removed


def test_channels_of_a_removed_robot_restart_their_count() -> None:
    captures = Captures()
    captures.capture_one(OTHER)
    captures.capture.remove_robot("R")
    captures.capture_one(OTHER)
    assert [frame.sequence for frame in captures.frames] == [1, 1]
