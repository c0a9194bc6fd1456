"""Students' scripts (tamsl/swe-thaf, makokal): their mistakes have no effect on the server."""

from __future__ import annotations

import pytest

from helpers.deadline import Deadline
from helpers.legacy_sockets import LineSocket
from helpers.server_process import DEADLINE_S, RunningServer


@pytest.fixture
def wire(server: RunningServer):
    """A connection with the scripts' read size."""
    with LineSocket(server.control_port, size=4024) as wire:
        yield wire


def read_true_position(wire: LineSocket) -> tuple[float, float]:
    """Next true x and y of the robot."""
    deadline = Deadline("GroundTruth line", DEADLINE_S)
    while "{Type GroundTruth}" not in (line := wire.read_line()):
        deadline.check()
    x, y, _ = line.partition("{Location ")[2].partition("}")[0].split(",")
    return float(x), float(y)


def test_drive_when_sent_a_hundred_times_without_line_end_does_nothing(wire: LineSocket) -> None:
    wire.send("INIT {ClassName USARBot.P2AT} {Location 0,0,0}\r\n")
    begin = read_true_position(wire)
    for _ in range(100):
        wire.send("DRIVE {Left 1.0} {Right 1.0}")
    for _ in range(3):
        assert read_true_position(wire) == begin
    # The completed line has the word of one DRIVE and the blocks of all of them: a valid command.
    wire.send("\r\n")
    deadline = Deadline("movement of 0.05 m", DEADLINE_S)
    while read_true_position(wire)[0] < begin[0] + 0.05:
        deadline.check()


def test_camera_when_its_field_of_view_is_set_sends_a_reply(wire: LineSocket) -> None:
    wire.send("INIT {ClassName USARBot.OmniP2AT} {Location 0,0,0}\r\n")
    wire.send("SET {Type Camera} {Name OmniCamPillar_Link4} {FOV 1}\r\n")
    reply = wire.read_line_starting_with("RES")
    # A mirror camera's model is fixed: the reply names the camera, with the status of a failure.
    assert "{Type Camera} {Name OmniCamPillar_Link4}" in reply
    assert "{Status Failed}" in reply
    assert "{Type GroundTruth}" in wire.read_line_starting_with("SEN {Time")


def test_location_when_its_commas_have_spaces_is_read(wire: LineSocket) -> None:
    wire.send("INIT {ClassName USARBot.P2AT} {Name R1} {Location .4, -.4, 1.8}\r\n")
    assert read_true_position(wire) == pytest.approx((0.4, -0.4), abs=0.011)
