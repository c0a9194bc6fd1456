"""Servers that end with their programs."""

from __future__ import annotations

import os
import re
import select
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from catoptra_client.control_connection import ServerAddress
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import connect_stream, run_server, start_server
from catoptra_protocol.errors import CatoptraError, ConnectionLostError
from helpers.server_process import DEADLINE_S

# Says that its server listens, then waits for its own end.
PROGRAM = """
import sys
from pathlib import Path
from catoptra_client.server_process import run_server

robot, world, log = Path("p2at_omni"), Path("four_legged_2006"), Path(sys.argv[1])
with run_server(robot, world, seed=0, log_file=log):
    print("listening", flush=True)
    sys.stdin.read()
"""
# The second, where a busy machine takes longer than the server allows for an end in order.
ENDS = re.compile(r"stopping|the process ends at once")


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGTERM])
def test_server_when_its_program_is_killed_ends(
    tmp_path: Path, signal_number: signal.Signals
) -> None:
    pytest.importorskip("catoptra_server")
    # A pipe: its end is the end of the last process that has it, the server.
    log = tmp_path / "server.log"
    os.mkfifo(log)
    descriptor = os.open(log, os.O_RDONLY | os.O_NONBLOCK)
    command = [sys.executable, "-c", PROGRAM, str(log)]
    with (
        open(descriptor, "rb"),
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as program,
    ):
        assert program.stdout is not None, "stdout is a pipe"
        assert program.stdout.readline() == "listening\n"
        program.send_signal(signal_number)
        assert ENDS.search(read_to_end(descriptor))


def read_to_end(descriptor: int) -> str:
    """Read a pipe until no process has its other end; fails where nothing comes for too long."""
    data = b""
    while select.select([descriptor], [], [], DEADLINE_S)[0]:
        part = os.read(descriptor, 4096)
        if not part:
            return data.decode()
        data += part
    raise AssertionError(f"the server does not end; its log: {data.decode()}")


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
