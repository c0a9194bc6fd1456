"""What is wanted of each channel: one shot under way, intervals kept, channels apart."""

from __future__ import annotations

from catoptra_server.imaging.shot import SCREEN, CameraChannel, Channel
from catoptra_server.simulation.reels import Reels

OTHER = CameraChannel("R", "Rear")


def due(reels: Reels, time_s: float) -> list[Channel]:
    return [channel for channel, _ in reels.due(time_s)]


def expose(reels: Reels, time_s: float, *, interval_s: float = 0.0) -> list[int]:
    return [reel.expose(time_s, interval_s=interval_s) for _, reel in reels.due(time_s)]


def test_channel_when_nobody_asked_is_not_due() -> None:
    assert due(Reels(), 0.0) == []


def test_channel_when_wanted_by_many_is_exposed_once() -> None:
    reels = Reels()
    for _ in range(3):
        reels.want(SCREEN, 0)
    assert expose(reels, 0.0) == [1]
    assert due(reels, 1.0) == []


def test_channel_when_wanted_while_it_is_drawn_waits_for_that() -> None:
    reels = Reels()
    reels.want(SCREEN, 0)
    expose(reels, 0.0)
    reels.want(SCREEN, 1)
    assert due(reels, 1.0) == []
    reels.drawn(SCREEN)
    assert due(reels, 1.0) == [SCREEN]


def test_channel_when_a_newer_shot_is_under_way_wants_no_other() -> None:
    reels = Reels()
    reels.want(SCREEN, 0)
    expose(reels, 0.0)
    reels.want(SCREEN, 0)
    reels.drawn(SCREEN)
    assert due(reels, 1.0) == []


def test_channel_when_it_has_an_interval_is_due_after_it() -> None:
    reels = Reels()
    reels.want(SCREEN, 0)
    expose(reels, 1.0, interval_s=0.1)
    reels.drawn(SCREEN)
    reels.want(SCREEN, 1)
    assert due(reels, 1.08) == []
    assert due(reels, 1.1) == [SCREEN]


def test_channels_when_there_are_two_count_apart() -> None:
    reels = Reels()
    reels.want(SCREEN, 0)
    reels.want(OTHER, 0)
    assert expose(reels, 0.0) == [1, 1]
    reels.drawn(OTHER)
    reels.want(OTHER, 1)
    assert due(reels, 0.0) == [OTHER]
    assert expose(reels, 0.0) == [2]
    assert reels.total() == 3


def test_channel_when_forgotten_counts_anew_and_late_drawings_do_no_harm() -> None:
    reels = Reels()
    reels.want(OTHER, 0)
    expose(reels, 0.0)
    reels.forget(OTHER)
    reels.drawn(OTHER)
    reels.want(OTHER, 5)
    assert expose(reels, 0.0) == [1]


def test_cameras_when_their_robot_left_are_forgotten_but_for_those_waited_for() -> None:
    reels, front = Reels(), CameraChannel("R", "Front")
    for channel in (OTHER, front, CameraChannel("S", "Rear"), SCREEN):
        reels.want(channel, 0)
    expose(reels, 0.0)
    reels.drawn(front)
    reels.want(front, 1)
    reels.forget_idle("R")
    assert reels.total() == 3  # all but the one that nobody waits for
    assert due(reels, 0.0) == [front]
