"""Students' scripts (tamsl/swe-thaf, makokal): what they got wrong must break nothing."""

from __future__ import annotations

import pytest

from helpers.legacy_sockets import LineSocket
from helpers.server_process import RunningServer


@pytest.fixture
def wire(server: RunningServer):
    """Yield a connection read as these scripts read it."""
    with LineSocket(server.control_port, size=4024) as wire:
        yield wire


def true_position(wire: LineSocket) -> tuple[float, float]:
    """Return the robot's true x and y."""
    while "{Type GroundTruth}" not in (line := wire.read_line()):
        pass
    x, y, _ = line.partition("{Location ")[2].partition("}")[0].split(",")
    return float(x), float(y)


def test_drive_when_sent_a_hundred_times_without_line_end_does_nothing(wire: LineSocket) -> None:
    wire.send("INIT {ClassName USARBot.P2AT} {Location 0,0,0}\r\n")
    begin = true_position(wire)
    for _ in range(100):
        wire.send("DRIVE {Left 1.0} {Right 1.0}")
    for _ in range(3):
        assert true_position(wire) == begin
    # The line that is completed at last has one DRIVE's word and the blocks of all: it drives.
    wire.send("\r\n")
    while true_position(wire)[0] < begin[0] + 0.05:
        pass


def test_camera_when_its_field_of_view_is_set_is_answered(wire: LineSocket) -> None:
    wire.send("INIT {ClassName USARBot.OmniP2AT} {Location 0,0,0}\r\n")
    wire.send("SET {Type Camera} {Name OmniCamPillar_Link4} {FOV 1}\r\n")
    answer = wire.read_line_starting_with("RES")
    # A mirror camera's law is fixed: the answer names the camera, and says that nothing changed.
    assert "{Type Camera} {Name OmniCamPillar_Link4}" in answer
    assert "{Status Failed}" in answer
    assert "{Type GroundTruth}" in wire.read_line_starting_with("SEN {Time")


def test_location_when_its_commas_have_spaces_is_understood(wire: LineSocket) -> None:
    wire.send("INIT {ClassName USARBot.P2AT} {Name R1} {Location .4, -.4, 1.8}\r\n")
    assert true_position(wire) == pytest.approx((0.4, -0.4), abs=0.011)
