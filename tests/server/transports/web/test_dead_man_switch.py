"""Robots that a page drives stop when its requests end."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from catoptra_protocol.stream.requests import DriveRequest
from catoptra_server.serve.web.page_socket import DRIVE_TIMEOUT_S, DeadManSwitch


class Clock:
    """Time and pending calls, under control of the test."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.calls: list[_Call] = []

    def call_later(self, delay_s: float, function: Callable[[], None]) -> _Call:
        call = _Call(self.now_s + delay_s, function)
        self.calls.append(call)
        return call

    def advance(self, duration_s: float) -> None:
        self.now_s += duration_s
        for call in [call for call in self.calls if call.at_s <= self.now_s]:
            self.calls.remove(call)
            if not call.is_cancelled:
                call.function()


class _Call:
    def __init__(self, at_s: float, function: Callable[[], None]) -> None:
        self.at_s, self.function, self.is_cancelled = at_s, function, False

    def cancel(self) -> None:
        self.is_cancelled = True


class Scene:
    """A switch, its clock, and the robots that it has stopped."""

    def __init__(self) -> None:
        self.clock, self.stopped = Clock(), list[str]()
        self.switch = DeadManSwitch(self.stopped.append, call_later=self.clock.call_later)

    def drive(self, left: float | None, right: float | None, robot: str = "") -> None:
        self.switch.record_drive(DriveRequest(1, left, right, False, robot))


def test_robot_when_requests_end_stops_once_within_a_quarter_of_a_second() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.clock.advance(0.99 * DRIVE_TIMEOUT_S)
    assert scene.stopped == []
    scene.clock.advance(0.02 * DRIVE_TIMEOUT_S)
    assert scene.stopped == [""]
    scene.clock.advance(10.0)
    assert scene.stopped == [""]


def test_robot_when_requests_go_on_does_not_stop() -> None:
    scene = Scene()
    for _ in range(100):
        scene.drive(1.0, -1.0)
        scene.clock.advance(0.05)
    assert scene.stopped == []


def test_robot_when_it_stands_is_not_stopped() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.drive(0.0, 0.0)
    scene.drive(None, None)
    scene.clock.advance(10.0)
    assert scene.stopped == []


@pytest.mark.parametrize(("left", "right"), [(0.0, None), (None, 0.0), (None, None)])
def test_robot_when_a_side_is_left_unchanged_still_moves(
    left: float | None, right: float | None
) -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.drive(left, right)
    scene.clock.advance(DRIVE_TIMEOUT_S)
    assert scene.stopped == [""]


def test_each_driven_robot_has_its_own_time() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0, "A")
    scene.clock.advance(0.6 * DRIVE_TIMEOUT_S)
    scene.drive(1.0, 1.0, "B")
    scene.clock.advance(0.6 * DRIVE_TIMEOUT_S)
    assert scene.stopped == ["A"]
    scene.clock.advance(0.6 * DRIVE_TIMEOUT_S)
    assert scene.stopped == ["A", "B"]


def test_robots_of_many_names_are_forgotten_after_their_stop() -> None:
    scene = Scene()
    for number in range(1000):
        scene.drive(1.0, 1.0, str(number))
    scene.clock.advance(DRIVE_TIMEOUT_S)
    assert len(scene.stopped) == 1000
    assert not scene.switch._speeds
    assert not scene.switch._timers


def test_switch_when_closed_stops_nothing_more() -> None:
    scene = Scene()
    scene.drive(1.0, 1.0)
    scene.switch.close()
    scene.clock.advance(10.0)
    assert scene.stopped == []
