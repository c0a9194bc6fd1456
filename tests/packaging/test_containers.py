"""Containers that end during a run: the client reports it and fails, the server goes on.

Needs a container engine and the images, which `make compose` builds. CATOPTRA_COMPOSE names another
command than `docker compose`.
"""

from __future__ import annotations

import contextlib
import os
import queue
import shlex
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from helpers.configs import REPOSITORY

COMPOSE = shlex.split(os.environ.get("CATOPTRA_COMPOSE", "docker compose"))
# Only an engine that does not answer takes so long.
DEADLINE_S = 120.0
# For one line of a log; longer than any step of the experiment on a slow machine.
WAIT_S = 120.0


def command(*words: str) -> list[str]:
    """Command line of compose, as a project beside the user's own."""
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
        created = compose("up", "--no-build", "--no-start", "--no-deps", "sim", "client")
    except (OSError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"needs a container engine: {error}")
    if created.returncode:
        reason = (created.stderr.strip().splitlines() or ["no reason given"])[-1]
        pytest.skip(f"needs a container engine, and images by make compose: {reason}")
    yield
    compose("down", "--timeout", "5")


class Containers:
    """Some of the services while they run, with the lines of their logs."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None, "stdout is a pipe"
        self._stream = process.stdout
        self._queue: queue.Queue[str | None] = queue.Queue()
        self.lines: list[str] = []
        # A thread, since reading a pipe has no timeout of its own.
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._stream:
            self._queue.put(line)
        self._queue.put(None)

    def wait_for(self, text: str, *, timeout_s: float = WAIT_S) -> str:
        """Wait for a line with a text, from now on."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            try:
                line = self._queue.get(timeout=max(deadline_s - time.monotonic(), 0.0))
            except queue.Empty:
                raise AssertionError(
                    f"no line with {text!r} in {timeout_s:g} s; the last were {self.lines[-5:]}"
                ) from None
            if line is None:
                raise AssertionError(f"ended without {text!r}; the last were {self.lines[-5:]}")
            self.lines.append(line)
            if text in line:
                return line

    def count(self, text: str) -> int:
        """Number of the lines so far with a text."""
        return sum(text in line for line in self.lines)


@contextmanager
def containers(*services: str) -> Iterator[Containers]:
    """Run some of the services and no others."""
    with subprocess.Popen(
        command("up", "--no-build", "--no-deps", *services),
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            yield Containers(process)
        finally:
            _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    """End a command of compose with all its processes."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def test_client_when_the_server_is_stopped_reports_an_error_and_fails() -> None:
    with containers("sim", "client") as running:
        running.wait_for("robot Run0 of class")
        compose("stop", "--timeout", "5", "sim")
        running.wait_for("catoptra-studies demo: ")
        assert "the client ended with 1" in running.wait_for("the client ended with")


def test_server_when_the_client_is_killed_frees_its_robot_and_serves_the_next(
    tmp_path: Path,
) -> None:
    with containers("sim", "client", "next") as running:
        running.wait_for("robot Run0 of class")
        compose("kill", "client")
        (tmp_path / "begin").touch()
        running.wait_for("robot Trainer0 of class")
        assert running.count(" spawned at ") == running.count(" removed") + 1
        running.wait_for("the next client is done")
