"""Servers as processes of a client: start, end, reasons of a failure, and the wait for a stream."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from catoptra_client.control_connection import ServerAddress
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import connect_stream, run_server, start_server
from catoptra_protocol.errors import CatoptraError, ConnectionLostError
from helpers.server_process import DEADLINE_S

ROBOT, WORLD = Path("p2at_omni"), Path("four_legged_2006")


def test_server_when_started_is_in_lockstep_and_ends_with_the_block(tmp_path: Path) -> None:
    with run_server(ROBOT, WORLD, seed=3, log_file=tmp_path / "log") as address:
        with connect_stream(address, timeout_s=DEADLINE_S) as client:
            assert client.get_status().clock == "lockstep"
        RobotClient.connect(address.host, address.control_port).close()
    with pytest.raises(ConnectionLostError, match="no control server"):
        RobotClient.connect(address.host, address.control_port)


def test_server_when_an_option_is_wrong_fails_with_the_end_of_its_log(tmp_path: Path) -> None:
    arguments = ("--robot", str(ROBOT), "--world", "no_such_world")
    with (
        pytest.raises(CatoptraError, match=r"(?s)did not start.*no_such_world"),
        start_server(arguments, log_file=tmp_path / "log"),
    ):
        pass


def test_stream_when_nothing_listens_times_out() -> None:
    with socket.socket() as held:  # bound, not listening: the port rejects connections
        held.bind(("127.0.0.1", 0))
        port = held.getsockname()[1]
        address = ServerAddress("127.0.0.1", port, port, stream_port=port)
        with pytest.raises(ConnectionLostError, match=f"no stream server at 127.0.0.1:{port}"):
            connect_stream(address, timeout_s=0.1)
