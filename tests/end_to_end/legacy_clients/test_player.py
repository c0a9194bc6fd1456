"""Player's USARSim driver: lines end in LF CR, vectors have spaces, y is to the left.

The driver needs lines that fit its buffer of 4096 bytes, and keys with exact names.
"""

from __future__ import annotations

import math
import re

import pytest

from helpers.deadline import Deadline
from helpers.legacy_sockets import connect, receive
from helpers.server_process import DEADLINE_S, RunningServer

_BUFFER_BYTES = 4096


class PlayerDriver:
    """One robot. Player's frames: x forward, y left, yaw counter-clockwise."""

    def __init__(self, port: int) -> None:
        self._connection = connect(port)
        self._buffer = b""
        self.overflows = 0

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def send_command(self, text: str) -> None:
        """Send a line with the driver's line end."""
        self._connection.sendall(text.encode() + b"\n\r")

    def spawn(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Spawn at a pose in Player's frame."""
        self.send_command(
            f"INIT {{ClassName USARBot.P2AT}} {{Name player}} "
            f"{{Location {x_m} {-y_m} 0.0}} {{Rotation 0.0 0.0 {-yaw_rad}}}"
        )

    def read_line(self) -> str:
        """Next line; a full buffer without a line end is discarded."""
        while b"\n" not in self._buffer:
            if len(self._buffer) >= _BUFFER_BYTES:
                self._buffer, self.overflows = b"", self.overflows + 1
            self._buffer += receive(self._connection, _BUFFER_BYTES - len(self._buffer))
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.strip(b"\r").decode()

    def read_report(self, type_: str) -> str:
        """Next report of a type."""
        deadline = Deadline(f"report of type {type_}", DEADLINE_S)
        while f"{{Type {type_}}}" not in (line := self.read_line()):
            deadline.check()
        return line

    def read_position(self) -> tuple[float, float, float]:
        """x, y, yaw of the true pose, in Player's frame."""
        line = self.read_report("GroundTruth")
        x, y, _ = _parse_numbers(line, "Location")
        yaw = -_parse_numbers(line, "Orientation")[2]
        return x, -y, math.remainder(yaw, math.tau)

    def read_laser(self) -> tuple[float, float, list[float]]:
        """angle_min, resolution, and the ranges in the order of the line."""
        line = self.read_report("RangeScanner")
        return (
            -0.5 * _parse_numbers(line, "FOV")[0],
            _parse_numbers(line, "Resolution")[0],
            _parse_numbers(line, "Range"),
        )

    def read_camera_fov(self) -> float:
        """Field of view of the camera, degrees, by a query."""
        self.send_command("GETCONF {Type Camera} {Name Camera}")
        deadline = Deadline("CONF line", DEADLINE_S)
        while not (line := self.read_line()).startswith("CONF"):
            deadline.check()
        return _parse_numbers(line, "CameraDefFov")[0]


def _parse_numbers(line: str, key: str) -> list[float]:
    found = re.search(rf"\{{{key} ([^}}]*)\}}", line)
    assert found, f"{key} is not in {line[:200]}"
    return [float(text) for text in found[1].split(",")]


@pytest.fixture
def player(server: RunningServer):
    """A driver without a robot."""
    driver = PlayerDriver(server.control_port)
    yield driver
    driver.close()


def test_pose_when_y_and_yaw_are_negated_both_ways_is_unchanged(player: PlayerDriver) -> None:
    player.spawn(0.5, 0.75, 0.5)
    assert player.read_position() == pytest.approx((0.5, 0.75, 0.5), abs=0.011)


def test_drive_when_the_right_wheels_are_faster_turns_counter_clockwise(
    player: PlayerDriver,
) -> None:
    player.spawn(0.0, 0.0, 0.0)
    player.send_command("DRIVE {Left -1.0} {Right 1.0}")
    deadline = Deadline("turn of 0.1 rad", DEADLINE_S)
    while (yaw := player.read_position()[2]) < 0.1:
        deadline.check()
        assert yaw > -0.01


def test_scan_when_stored_unreversed_has_the_left_wall_on_the_left(player: PlayerDriver) -> None:
    player.spawn(0.0, 0.0, 0.0)
    angle_min, resolution, ranges = player.read_laser()
    assert len(ranges) == 181
    angles = [angle_min + index * resolution for index in range(len(ranges))]
    # The walls of the room: 3 m on the right, 2 m on the left, 4 m ahead of the robot.
    for angle, distance in ((-0.5 * math.pi, 3.0), (0.0, 4.0 - 0.144), (0.5 * math.pi, 2.0)):
        nearest = min(range(len(ranges)), key=lambda i: abs(angles[i] - angle))
        assert ranges[nearest] == pytest.approx(distance, abs=0.05)


def test_camera_when_queried_has_its_default_field_of_view(player: PlayerDriver) -> None:
    player.spawn(0.0, 0.0, 0.0)
    assert player.read_camera_fov() == pytest.approx(45.0, abs=0.01)


def test_lines_when_read_into_the_drivers_buffer_all_fit(player: PlayerDriver) -> None:
    player.spawn(0.0, 0.0, 0.0)
    for _ in range(3):
        player.read_report("GroundVehicle")
    assert player.overflows == 0
