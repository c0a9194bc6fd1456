"""Protocol and client where ROS lives: on the Python of an older ROS, and without POSIX."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from helpers.configs import REPOSITORY
from helpers.server_process import DEADLINE_S

# What Windows does not have. Other packages, and Python itself, are loaded as on this system.
WITHOUT_POSIX = """
import importlib, multiprocessing.resource_tracker, os, pkgutil, select, signal, sys, tempfile
import cv2, gymnasium, lz4.frame, mcap.writer, mcap_ros2._dynamic, msgpack, numpy, yaml, zmq

for name in ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "readline", "syslog"):
    sys.modules[name] = None
for module, names in {
    signal: "SIGHUP SIGKILL SIGPIPE SIGQUIT SIGUSR1 SIGCHLD SIG_BLOCK pthread_sigmask",
    os: "fork getuid geteuid getpgid killpg setsid sched_getaffinity mkfifo uname",
    select: "poll epoll",
}.items():
    for name in names.split():
        delattr(module, name)
count = 0
for package in ("catoptra_protocol", "catoptra_client"):
    path = importlib.import_module(package).__path__
    for module in pkgutil.walk_packages(path, package + "."):
        importlib.import_module(module.name)
        count += 1
print(count)
from catoptra_client.__main__ import main
main(["--help"])
"""


def test_protocol_and_client_load_without_modules_of_posix() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_POSIX], capture_output=True, text=True, timeout=DEADLINE_S
    )
    assert done.returncode == 0, done.stderr
    count, help_ = done.stdout.split("\n", 1)
    assert int(count) > 100
    assert "snapshot" in help_


@pytest.mark.parametrize("version", ["3.10", "3.12", "3.13", "3.14"])
def test_client_of_another_python_records_a_server_of_this_one(version: str) -> None:
    python = REPOSITORY / "out/pythons" / version / "bin/python"
    if not python.exists():
        pytest.skip(f"needs Python {version} with the client's packages: make pythons")
    done = subprocess.run(
        [python, "-m", "pytest", "-q", "tests/client/recording/test_recorder.py"],
        cwd=REPOSITORY,
        env=os.environ | {"CATOPTRA_SERVER_PYTHON": sys.executable},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout
    assert "skipped" not in done.stdout
