"""A newcomer beside one program that holds most places of every port: it gets in, and sees."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from catoptra_client.robot_client import RobotClient
from helpers.server_process import DEADLINE_S, RunningServer, start_server

HOST = "127.0.0.1"
CLASS = "USARBot.OmniP2AT"
INIT = "INIT {{ClassName {}}} {{Name R{}}} {{Location {},{},0}}\r\n"


@contextmanager
def hold_places(server: RunningServer, kind: str) -> Iterator[None]:
    """Hold places of a port for the length of a block, by one program."""
    with ExitStack() as held:

        def connect(port: int) -> socket.socket:
            return held.enter_context(socket.create_connection((HOST, port), DEADLINE_S))

        match kind:
            case "silent":
                for port in (server.control_port, server.image_port, server.stream_port):
                    for _ in range(64):
                        connect(port)
            case "robots":
                for number in range(62):
                    controller = connect(server.control_port)
                    x_m, y_m = 0.5 * (number % 8) - 2.0, 0.5 * (number // 8) - 2.0
                    controller.sendall(INIT.format(CLASS, number, x_m, y_m).encode())
                    # The greeting, then the first reports: the robot is there.
                    received = b""
                    while b"STA" not in received:
                        received += controller.recv(4096)
        yield


@pytest.mark.parametrize("kind", ["silent", "robots"])
def test_newcomer_gets_in_spawns_and_sees(tmp_path: Path, kind: str) -> None:
    with start_server(tmp_path) as server, hold_places(server, kind):
        with server.connect_robot() as robot, server.connect_images() as images:
            assert isinstance(robot, RobotClient)
            robot.spawn(CLASS, start_pose="Centre")
            assert images.get_frame().rgb.any()
        with server.connect_stream() as client:
            client.spawn(CLASS, location_m=(1.0, 1.0, 0.0))
            assert client.get_frame(robot=client.get_state().robots[-1].name).rgb.any()
