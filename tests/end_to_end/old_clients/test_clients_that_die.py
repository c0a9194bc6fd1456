"""Clients that are killed, repeat themselves or send nothing but line ends."""

from __future__ import annotations

from helpers.old_sockets import LineSocket, connected, die
from helpers.server_process import RunningServer

INIT = "INIT {{ClassName USARBot.OmniP2AT}} {{Name {0}}} {{Location {1},0,0}}\r\n"


def spawned(server: RunningServer, name: str, x_m: float = 0.0) -> LineSocket:
    """Return a connection whose robot has reported."""
    wire = LineSocket(server.control_port, size=4096)
    wire.send(INIT.format(name, x_m))
    wire.line_with("STA")
    return wire


def shown_next(server: RunningServer, before: str) -> str:
    """Return the name of the robot that the stream shows once it shows another; empty: none.

    Pictures are a moment old, so the last robot may still be there in the first of them.
    """
    with server.stream() as stream:
        return next(frame.robot or "" for frame in stream.frames() if frame.robot != before)


def test_robot_when_its_client_is_reset_is_gone_and_its_name_free(server: RunningServer) -> None:
    for _ in range(3):
        wire = spawned(server, "Lost")
        assert shown_next(server, "") == "Lost"
        die(wire.connection)
        assert shown_next(server, "Lost") == ""


def test_name_when_taken_gets_a_number(server: RunningServer) -> None:
    with spawned(server, "Same") as first:
        assert shown_next(server, "") == "Same"
        with spawned(server, "Same", x_m=1.5):
            first.connection.close()
            name = shown_next(server, "Same")
    assert name.startswith("Same")
    assert name[4:].isdigit()
    assert shown_next(server, name) == ""


def test_second_init_when_sent_moves_and_adds_nothing(server: RunningServer) -> None:
    with spawned(server, "First") as wire:
        wire.send(INIT.format("Second", 1.5))
        wire.send("GETSTARTPOSES\r\n")
        wire.line_with("NFO {StartPoses")
        assert "{Location 0.0" in wire.line_with("SEN {Time")
        assert shown_next(server, "") == "First"
    # A robot named Second would be shown now.
    assert shown_next(server, "First") == ""


def test_lone_line_ends_when_sent_are_nothing(server: RunningServer) -> None:
    with LineSocket(server.control_port, size=4096) as wire:
        for end in ("\r", "\n", "\n\r", "\r\n\n", "\r\r\r", "\r\n\r\n"):
            wire.send(end)
        wire.send("GETSTARTPOSES\r")
        assert wire.line().startswith("NFO {Gametype")
        assert wire.line().startswith("NFO {StartPoses 2}")


def test_viewer_when_reset_between_request_and_frame_costs_the_next_nothing(
    server: RunningServer,
) -> None:
    for _ in range(5):
        viewer = connected(server.image_port)
        viewer.sendall(b"OK" * 10)
        die(viewer)
    with server.images() as images:
        assert images.frame().rgb.shape == (64, 64, 3)
