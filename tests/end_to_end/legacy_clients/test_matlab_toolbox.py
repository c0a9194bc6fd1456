"""The MATLAB toolbox: lines of single reads of 4096 bytes, and a y of zero that is replaced."""

from __future__ import annotations

import re

import pytest

from helpers.deadline import Deadline
from helpers.legacy_sockets import connect, receive
from helpers.server_process import DEADLINE_S, RunningServer


class MatlabRobot:
    """One robot. Lines are those within one read; a line cut by the end of a read is lost."""

    def __init__(self, port: int) -> None:
        self._connection = connect(port)

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def init(self, x: str, y: str, z: str) -> None:
        """Spawn; a y of zero becomes 0.1."""
        y = "0.1" if float(y) == 0.0 else y
        text = f"INIT {{ClassName USARBot.P2AT}} {{Name matlab}} {{Location {x}, {y}, {z}}}\r\n"
        self._connection.sendall(text.encode())

    def drive(self, left: float, right: float) -> None:
        """Set the wheel speeds."""
        self._connection.sendall(f"DRIVE {{Left {left}}} {{Right {right}}}\r\n".encode())

    def read_lines(self) -> list[str]:
        """Complete lines of one read."""
        text = receive(self._connection, 4096).decode()
        return text.split("\r\n")[:-1]

    def read_location(self) -> tuple[float, float, float]:
        """Location of the next complete GroundTruth line."""
        pattern = r"SEN \{Time [\d.]+\} \{Type GroundTruth\}.*\{Location (\S+),(\S+),(\S+)\}.*"
        deadline = Deadline("complete GroundTruth line", DEADLINE_S)
        while True:
            deadline.check()
            for line in self.read_lines():
                if found := re.fullmatch(pattern, line):
                    x, y, z = map(float, found.groups())
                    return x, y, z


@pytest.fixture
def robot(server: RunningServer):
    """A connection of the toolbox."""
    robot = MatlabRobot(server.control_port)
    yield robot
    robot.close()


def test_location_when_its_numbers_lack_zeros_is_read(robot: MatlabRobot) -> None:
    robot.init(".4", ".4", "1.8")
    assert robot.read_location()[:2] == pytest.approx((0.4, 0.4), abs=0.011)


def test_location_when_y_was_zero_is_the_one_that_was_sent(robot: MatlabRobot) -> None:
    robot.init("-1", "0", "1.8")
    assert robot.read_location()[:2] == pytest.approx((-1.0, 0.1), abs=0.011)


def test_location_when_partial_lines_are_lost_still_follows_the_robot(robot: MatlabRobot) -> None:
    robot.init("0", "0", "1.8")
    begin = robot.read_location()
    robot.drive(2.0, 2.0)
    deadline = Deadline("movement of 0.1 m", DEADLINE_S)
    while robot.read_location()[0] < begin[0] + 0.1:
        deadline.check()
