"""Stop of robots that a page drives: one that is hidden, closed or cut off sends nothing more."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from catoptra_protocol.stream.requests import DriveRequest

# The page sends 20 requests a second while it drives.
DRIVE_TIMEOUT_S = 0.25


class Timer(Protocol):
    """A pending call."""

    def cancel(self) -> None:
        """Cancel the call."""


CallLater = Callable[[float, Callable[[], None]], Timer]


class DeadManSwitch:
    """The robots that one page drives at present, by name; its own has the empty name."""

    def __init__(self, stop: Callable[[str], None], *, call_later: CallLater) -> None:
        """Start without a robot.

        Args:
            stop: Sets both wheel speeds of a robot to 0.
            call_later: Calls a function after some seconds.
        """
        self._stop = stop
        self._call_later = call_later
        # Robots that stand are not listed: a page cannot fill the dict with names.
        self._speeds: dict[str, tuple[float, float]] = {}
        self._timers: dict[str, Timer] = {}

    def record_drive(self, request: DriveRequest) -> None:
        """Record a request to drive; after the last one the robot stops in time."""
        robot = request.robot
        left, right = self._speeds.pop(robot, (0.0, 0.0))
        if robot in self._timers:
            self._timers.pop(robot).cancel()
        left = left if request.left is None else request.left
        right = right if request.right is None else request.right
        if left or right:
            self._speeds[robot] = left, right
            self._timers[robot] = self._call_later(DRIVE_TIMEOUT_S, lambda: self._stop_robot(robot))

    def close(self) -> None:
        """End without a stop: the simulation halts what a disconnected client drives."""
        for timer in self._timers.values():
            timer.cancel()
        self._timers.clear()

    def _stop_robot(self, robot: str) -> None:
        del self._timers[robot], self._speeds[robot]
        self._stop(robot)
