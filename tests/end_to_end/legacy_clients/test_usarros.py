"""usarros: all commands in the segment of INIT, before the greeting is read; a roll of pi."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from helpers.deadline import Deadline
from helpers.legacy_sockets import LineSocket
from helpers.server_process import DEADLINE_S, RunningServer


@pytest.fixture
def wire(server: RunningServer) -> Iterator[LineSocket]:
    """The connection after the client's first segment."""
    with LineSocket(server.control_port, size=1024) as wire:
        wire.send(
            "INIT {ClassName USARBot.P2AT} {Name ros} {Location 0.5,0.5,-0.3} "
            "{Rotation 3.141593,0.0,0.5}\r\n"
            "GETSTARTPOSES\r\n"
            "GETGEO {Type Robot}\r\n"
            "GETCONF {Type Robot}\r\n"
            "GETCONF {Type RangeScanner} {Name Scanner1}\r\n"
            "DRIVE {Left 1.0} {Right 1.0}\r\n"
        )
        yield wire


def test_commands_behind_init_are_executed_in_order(wire: LineSocket) -> None:
    expected = ["NFO {Gametype", "SEN", "NFO {StartPoses 2}", "GEO {Type GroundVehicle}"]
    for start in (*expected, "CONF {Type GroundVehicle}", "CONF {Type RangeScanner}"):
        wire.read_line_starting_with(start)


def test_robot_when_spawned_with_a_roll_of_pi_stands_upright_and_drives(wire: LineSocket) -> None:
    locations = []
    deadline = Deadline("sixth GroundTruth line", DEADLINE_S)
    while len(locations) < 6:
        deadline.check()
        if "{Type GroundTruth}" in (line := wire.read_line()):
            numbers = (
                line.replace("}", ",").replace("{Location ", ",").replace("{Orientation ", ",")
            )
            x, y, z, roll, pitch, yaw = map(float, filter(_is_number, numbers.split(",")))
            assert (roll, pitch, yaw) == pytest.approx((0.0, 0.0, 0.5), abs=0.011)
            assert -0.2 < z < 0.0
            locations.append((x, y))
    assert locations[0] == pytest.approx((0.5, 0.5), abs=0.011)
    # Ahead at half a radian clockwise: x and y grow.
    assert locations[-1][0] > locations[0][0] + 0.05
    assert locations[-1][1] > locations[0][1] + 0.02


def _is_number(text: str) -> bool:
    return text.strip().lstrip("-").replace(".", "", 1).isdigit()
