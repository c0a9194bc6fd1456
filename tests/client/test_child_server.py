"""Servers that a program starts end with it, also where it is killed."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

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
