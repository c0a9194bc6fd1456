"""Clients that are killed, repeat themselves or send nothing but line ends."""

from __future__ import annotations

from helpers.deadline import Deadline
from helpers.legacy_sockets import LineSocket, connect, reset_connection
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


def test_robot_when_its_connection_is_reset_is_removed_and_its_name_free(
    server: RunningServer,
) -> None:
    for _ in range(3):
        wire = spawn_robot(server, "Lost")
        assert next_shown_robot(server, "") == "Lost"
        reset_connection(wire.connection)
        assert next_shown_robot(server, "Lost") == ""


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


def test_lone_line_ends_when_sent_have_no_effect(server: RunningServer) -> None:
    with LineSocket(server.control_port, size=4096) as wire:
        for end in ("\r", "\n", "\n\r", "\r\n\n", "\r\r\r", "\r\n\r\n"):
            wire.send(end)
        wire.send("GETSTARTPOSES\r")
        assert wire.read_line().startswith("NFO {Gametype")
        assert wire.read_line().startswith("NFO {StartPoses 2}")


def test_viewer_when_reset_before_its_frame_leaves_the_next_one_unaffected(
    server: RunningServer,
) -> None:
    for _ in range(5):
        viewer = connect(server.image_port)
        viewer.sendall(b"OK" * 10)
        reset_connection(viewer)
    with server.connect_images() as images:
        assert images.get_frame().rgb.shape == (64, 64, 3)
