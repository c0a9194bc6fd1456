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
    """Return the command line of compose on our file, as a project beside the user's own."""
    return [*COMPOSE, "-p", "catoptra-test", "-f", "docker/compose.yaml", *words]


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
    """Start the simulated set-up's server; skip where that cannot be done."""
    monkeypatch.setenv("CATOPTRA_OUT", str(tmp_path))
    monkeypatch.setenv("CATOPTRA_USER", f"{os.getuid()}:{os.getgid()}")
    try:
        there = compose("up", "-d", "--no-build", "--no-deps", "sim")
    except (OSError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"needs a container engine: {error}")
    if there.returncode:
        reason = (there.stderr.strip().splitlines() or ["it gave no reason"])[-1]
        pytest.skip(f"needs a container engine, and images by make compose: {reason}")
    yield
    compose("down", "--timeout", "5")


def log_until(line: str, *, times: int = 1) -> list[str]:
    """Return the log of the server up to the line that has a text for the n-th time."""
    lines: list[str] = []
    with subprocess.Popen(
        command("logs", "--follow", "sim"),
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        watchdog = threading.Timer(DEADLINE_S, end, (process,))
        watchdog.start()
        assert process.stdout is not None, "stdout is a pipe"
        for said in process.stdout:
            lines.append(said)
            if sum(line in said for said in lines) == times:
                break
        watchdog.cancel()
        end(process)
    assert sum(line in said for said in lines) == times, lines[-5:]
    return lines


def end(process: subprocess.Popen[str]) -> None:
    """End a command of compose with all that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def client() -> Iterator[subprocess.Popen[str]]:
    """Run the experiment, which begins with the simulated set-up, until the block ends it."""
    with subprocess.Popen(
        command("up", "--no-build", "--no-deps", "--exit-code-from", "client", "client"),
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        watchdog = threading.Timer(DEADLINE_S, end, (process,))
        watchdog.start()
        yield process
        process.wait(DEADLINE_S)
        watchdog.cancel()


def test_server_when_the_client_is_killed_frees_its_robot_and_serves_the_next() -> None:
    with client():
        log_until("robot Run0 of class")
        compose("kill", "client")
    with client():
        lines = log_until("robot Trainer0 of class", times=2)
        compose("kill", "client")
    came, left = (sum(word in line for line in lines) for word in (" spawned at ", " left\n"))
    assert came == left + 1, "only the new client's robot is there"


def test_client_when_the_server_is_stopped_says_so_and_fails() -> None:
    with client() as process:
        log_until("robot Run0 of class")
        compose("stop", "--timeout", "5", "sim")
        said, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1
    assert "experiment: " in said
