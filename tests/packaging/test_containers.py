"""Containers that end in the middle: the client says so and fails, the server goes on.

Needs a container engine and the images, which `make compose` builds. CATOPTRA_COMPOSE names another
command than `docker compose`.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from helpers.configs import REPOSITORY

COMPOSE = shlex.split(os.environ.get("CATOPTRA_COMPOSE", "docker compose"))
# Only a broken test, or an engine that does not answer, takes so long.
DEADLINE_S = 120.0


def command(*words: str) -> list[str]:
    """Return a command line of compose, as a project beside the user's own."""
    files = ("-f", "docker/compose.yaml", "-f", "tests/packaging/in_the_middle.yaml")
    return [*COMPOSE, "-p", "catoptra-test", *files, *words]


def compose(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command of compose to its end."""
    return subprocess.run(
        command(*words),
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
        timeout=DEADLINE_S,
    )


@pytest.fixture(autouse=True)
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Skip where no containers run; leave none behind."""
    monkeypatch.setenv("CATOPTRA_OUT", str(tmp_path))
    monkeypatch.setenv("CATOPTRA_USER", f"{os.getuid()}:{os.getgid()}")
    try:
        there = compose("up", "--no-build", "--no-start", "--no-deps", "sim", "client")
    except (OSError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"needs a container engine: {error}")
    if there.returncode:
        reason = (there.stderr.strip().splitlines() or ["it gave no reason"])[-1]
        pytest.skip(f"needs a container engine, and images by make compose: {reason}")
    yield
    compose("down", "--timeout", "5")


class Containers:
    """Some of the services while they run, and what they have said."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None, "stdout is a pipe"
        self._lines = process.stdout
        self.said: list[str] = []

    def wait_for(self, text: str) -> str:
        """Read until a line has a text; return it."""
        for line in self._lines:
            self.said.append(line)
            if text in line:
                return line
        raise AssertionError(f"nobody said {text!r}: {self.said[-5:]}")

    def parse_number(self, text: str) -> int:
        """Return how many of the lines that were read have a text."""
        return sum(text in line for line in self.said)


@contextmanager
def containers(*services: str) -> Iterator[Containers]:
    """Run some of the services, and nothing else."""
    with subprocess.Popen(
        command("up", "--no-build", "--no-deps", *services),
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        watchdog = threading.Timer(DEADLINE_S, _end, (process,))
        watchdog.start()
        try:
            yield Containers(process)
        finally:
            watchdog.cancel()
            _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    """End a command of compose with all that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def test_client_when_the_server_is_stopped_says_so_and_fails() -> None:
    with containers("sim", "client") as running:
        running.wait_for("robot Run0 of class")
        compose("stop", "--timeout", "5", "sim")
        running.wait_for("experiment: ")
        assert "the client ended with 1" in running.wait_for("the client ended with")


def test_server_when_the_client_is_killed_frees_its_robot_and_serves_the_next(
    tmp_path: Path,
) -> None:
    with containers("sim", "client", "next") as running:
        running.wait_for("robot Run0 of class")
        compose("kill", "client")
        (tmp_path / "begin").touch()
        running.wait_for("robot Trainer0 of class")
        assert running.parse_number(" spawned at ") == running.parse_number(" left") + 1
        running.wait_for("the next client is done")
