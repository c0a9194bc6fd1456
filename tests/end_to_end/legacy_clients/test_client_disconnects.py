"""Clients that take a name that is taken, or send INIT twice."""

from __future__ import annotations

from helpers.deadline import Deadline
from helpers.legacy_sockets import LineSocket
from helpers.server_process import DEADLINE_S, RunningServer

INIT = "INIT {{ClassName USARBot.OmniP2AT}} {{Name {0}}} {{Location {1},0,0}}\r\n"


def spawn_robot(server: RunningServer, name: str, x_m: float = 0.0) -> LineSocket:
    """Connection with a robot that has reported."""
    wire = LineSocket(server.control_port, size=4096)
    wire.send(INIT.format(name, x_m))
    wire.read_line_starting_with("STA")
    return wire


def next_shown_robot(server: RunningServer, before: str) -> str:
    """Robot of the first frame that shows another one than before; empty for none.

    Frames are some milliseconds old: the first ones may still show the earlier robot.
    """
    deadline = Deadline(f"frame of another robot than {before!r}", DEADLINE_S)
    with server.connect_stream() as stream:
        for frame in stream.iter_frames():
            if frame.robot_name != before:
                return frame.robot_name or ""
            deadline.check()
    raise AssertionError("the stream ended")


def test_name_when_taken_gets_a_number(server: RunningServer) -> None:
    with spawn_robot(server, "Same") as first:
        assert next_shown_robot(server, "") == "Same"
        with spawn_robot(server, "Same", x_m=1.5):
            first.connection.close()
            name = next_shown_robot(server, "Same")
    assert name.startswith("Same")
    assert name[4:].isdigit()
    assert next_shown_robot(server, name) == ""


def test_second_init_when_sent_moves_and_adds_nothing(server: RunningServer) -> None:
    with spawn_robot(server, "First") as wire:
        wire.send(INIT.format("Second", 1.5))
        wire.send("GETSTARTPOSES\r\n")
        wire.read_line_starting_with("NFO {StartPoses")
        assert "{Location 0.0" in wire.read_line_starting_with("SEN {Time")
        assert next_shown_robot(server, "") == "First"
    # A robot named Second would be shown now.
    assert next_shown_robot(server, "First") == ""
