"""The command as a user runs it: a link at once, Ctrl-C, a server that ends."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

import pytest

from catoptra_client.control_connection import ServerAddress
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import connect_stream
from catoptra_protocol.errors import ConnectionLostError
from catoptra_studies.live.live_drive import ROBOT_NAME
from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S


@contextmanager
def run_live(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run the command on free ports for the length of a block."""
    command = [sys.executable, "-m", "catoptra_studies", "live", "--view", "0"]
    with subprocess.Popen(
        [*command, "--out", str(folder), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            # By SIGTERM the command ends its server, too.
            process.terminate()


def read_text(process: subprocess.Popen[str]) -> list[str]:
    """Lines that the command prints up to the link."""
    ready, _, _ = select.select([process.stdout], [], [], DEADLINE_S)
    assert ready, "the command printed nothing"
    lines: list[str] = []
    for line in process.stdout:
        lines.append(line.rstrip())
        if line.startswith("Watch it at"):
            return lines
    raise AssertionError(f"no link in {lines}")


def read_port(lines: list[str], name: str) -> int:
    return int(re.search(rf"(\d+) \({name}\)", "\n".join(lines))[1])


def find_server(process: subprocess.Popen[str]) -> int:
    """Process of the server: the only child of the command."""
    (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return int(child)


def wait_for_robot(stream_port: int) -> None:
    """Wait until the robot of the command is in the world."""
    deadline = Deadline("robot", DEADLINE_S)
    address = ServerAddress("127.0.0.1", 0, 0, stream_port)
    with connect_stream(address, timeout_s=DEADLINE_S) as viewer:
        while not any(robot.name == ROBOT_NAME for robot in viewer.get_state().robots):
            deadline.check()


@pytest.mark.parametrize(
    ("number", "arguments"),
    [(signal.SIGINT, ()), (signal.SIGTERM, ("--world", "arena"))],
    ids=["Ctrl-C", "SIGTERM in the arena"],
)
def test_command_when_interrupted_ends_with_one_line_and_its_server(tmp_path, number, arguments):
    with run_live(tmp_path, *arguments) as process:
        lines = read_text(process)
        link = lines[-1].removeprefix("Watch it at ")
        with urlopen(link, timeout=DEADLINE_S) as page:
            assert page.status == 200
        wait_for_robot(read_port(lines, "stream"))
        process.send_signal(number)
        rest, errors = process.communicate(timeout=DEADLINE_S)
        assert (rest, errors) == ("live: server and robot have ended\n", "")
        assert process.returncode == 128 + number
    with pytest.raises(ConnectionLostError):
        RobotClient.connect(port=read_port(lines, "control"))


def test_command_when_its_server_is_lost_names_the_reason_and_fails(tmp_path):
    with run_live(tmp_path) as process:
        wait_for_robot(read_port(read_text(process), "stream"))
        os.kill(find_server(process), signal.SIGKILL)
        _, errors = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == 1
        assert re.fullmatch(r"catoptra-studies live: lost the .*\n", errors)


def test_command_when_the_robot_is_unknown_shows_the_servers_reason(tmp_path):
    with run_live(tmp_path, "--robot", "no_such_robot") as process:
        printed, errors = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == 1
        assert printed == ""
        assert "did not start" in errors
        assert "no_such_robot" in errors
