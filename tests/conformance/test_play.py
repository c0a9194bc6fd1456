"""The command against our own server, correct variants of it, and servers that misbehave."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from conformance.play import main
from helpers.cell_world import write_cell_world, write_sensor_robot
from helpers.server_process import start_server


@contextmanager
def serve_once(*pieces: bytes, connections: int = 1) -> Iterator[str]:
    """Accept connections, send these bytes, close each; after the last one nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            for _ in range(connections):
                connection, _ = listener.accept()
                with connection:
                    connection.sendall(b"".join(pieces))
            listener.close()

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"127.0.0.1:{listener.getsockname()[1]}"
        thread.join()


def test_command_when_the_rows_pass_prints_them_and_succeeds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, world = write_sensor_robot(tmp_path), write_cell_world(tmp_path)
    with start_server(tmp_path, robot=robot, world=world) as server:
        control, image, stream = (
            f"127.0.0.1:{port}"
            for port in (server.control_port, server.image_port, server.stream_port)
        )
        rows = ("--rows", "greeting", "spawn_pose", "image_full*", "stream_clients")
        status = main([control, "--image", image, "--stream", stream, *rows])
    printed = capsys.readouterr().out
    assert status == 0, printed
    assert "robot class USARBot.OmniP2AT, of pictures USARBot.OmniP2AT; {Start Cell0}" in printed
    assert "4 rows: 4 passed" in printed


def test_command_without_a_server_prints_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = "127.0.0.1:{1}".format(*listener.getsockname())
    assert main([address]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines() == [
        f"no server at {address} (control port): Connection refused"
    ]


def test_command_when_the_server_dies_fails_its_rows(capsys: pytest.CaptureFixture[str]) -> None:
    with serve_once(b"NFO {Gametype A} {Level B} {TimeLimit 0}\r\n", connections=3) as address:
        status = main([address, "--robot-class", "A", "--rows", "greeting", "drive", "tour"])
    assert status == 1
    assert "3 rows: 0 passed, 3 failed" in capsys.readouterr().out
