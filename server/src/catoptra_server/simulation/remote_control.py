"""Robots that clients other than their owners drive, where the owners allow it."""

from __future__ import annotations

from collections.abc import Mapping

from catoptra_protocol.usarsim.commands import Drive
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.simulation_events import Client

_HALT = Drive(0.0, 0.0)


class RemoteControl:
    """Who drives whose robot. A robot halts once its driver disconnects or may not drive it."""

    def __init__(self, robots: Mapping[Client, Robot]) -> None:
        """Begin with robots that their owners drive.

        Args:
            robots: Robots by owner; a view, in which robots come and go.
        """
        self._robots = robots
        # Driver by owner, for the robots that roll by the command of another client.
        self._drivers: dict[Client, Client] = {}

    def drive(self, client: Client, name: str, drive: Drive, time_s: float) -> str:
        """Drive the robot of a name; the reason if the client may not, else an empty text."""
        found = next((item for item in self._robots.items() if item[1].name == name), None)
        if found is None:
            return f"there is no robot {name!r}"
        owner, robot = found
        if owner is not client and not robot.shares_control:
            return f"the owner of robot {name!r} does not share its control (share_control)"
        robot.drive_wheels(drive, time_s)
        self._drivers.pop(owner, None)
        if owner is not client and robot.is_rolling:
            self._drivers[owner] = client
        return ""

    def release(self, owner: Client) -> None:
        """Record that the owner drives the robot itself, or has none any more."""
        self._drivers.pop(owner, None)

    def share(self, owner: Client, shared: bool, time_s: float) -> None:
        """Let others drive the robot of a client, or no longer; without a robot of no effect."""
        robot = self._robots.get(owner)
        if robot is not None:
            robot.shares_control = shared
            if not shared:
                self._halt(owner, time_s)

    def halt_robots_driven_by(self, client: Client, time_s: float) -> None:
        """Halt the robots that roll by the command of a client that disconnects."""
        for owner in [owner for owner, driver in self._drivers.items() if driver is client]:
            self._halt(owner, time_s)

    def _halt(self, owner: Client, time_s: float) -> None:
        """Halt a robot that another client drives."""
        if self._drivers.pop(owner, None) is not None:
            self._robots[owner].drive_wheels(_HALT, time_s)
