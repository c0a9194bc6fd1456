"""Servers that a program starts end with it, also where it is killed."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.server_process import DEADLINE_S

# Prints the control port of its server, then waits for its own end.
PROGRAM = """
import sys
from pathlib import Path
from catoptra_client.server_process import run_server

robot, world, log = Path("p2at_omni"), Path("four_legged_2006"), Path(sys.argv[1])
with run_server(robot, world, seed=0, log_file=log) as address:
    print(address.control_port, flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGTERM])
def test_server_when_its_program_is_killed_ends_in_order(
    tmp_path: Path, signal_number: signal.Signals
) -> None:
    log = tmp_path / "server.log"
    command = [sys.executable, "-c", PROGRAM, str(log)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdout is not None, "stdout is a pipe"
        address = ("127.0.0.1", int(program.stdout.readline()))
        with socket.create_connection(address, DEADLINE_S) as connection:
            program.send_signal(signal_number)
            # Reads the greeting, then to the end that the server's own end gives the connection.
            while connection.recv(4096):
                pass
    assert "stopping" in log.read_text()
