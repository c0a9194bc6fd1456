"""A real server process on free ports, as the tests' clients meet one.

Nothing ends a healthy server before its block does: start and end have a deadline each, a client's
waits have their own timeouts, and a server whose test process is gone ends itself (child_server).
"""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.robot_client import RobotClient
from helpers.configs import FIELD, OMNI_ROBOT, Edit, write_edited_copy

# Thirty times a start on two busy cores; a wait that takes so long has failed.
DEADLINE_S = 60.0
# A client's Python need not be the server's: `make pythons`.
SERVER_PYTHON = os.environ.get("CATOPTRA_SERVER_PYTHON", sys.executable)
CHILD_SERVER = Path(__file__).with_name("child_server.py")
LISTENING_PATTERN = re.compile(
    r"listening control=127\.0\.0\.1:(\d+) image=127\.0\.0\.1:(\d+) stream=127\.0\.0\.1:(\d+)\n"
)


@dataclass(frozen=True, slots=True)
class RunningServer:
    """A server process that listens, its ports and its log file."""

    process: subprocess.Popen[str]
    control_port: int
    image_port: int
    stream_port: int
    log: Path

    def connect_robot(self) -> RobotClient:
        """Connect to the control port."""
        return RobotClient.connect(port=self.control_port, timeout_s=DEADLINE_S)

    def connect_images(self) -> ImageClient:
        """Connect to the image port."""
        return ImageClient.connect(port=self.image_port, timeout_s=DEADLINE_S)

    def connect_stream(self) -> StreamClient:
        """Connect to the stream."""
        return StreamClient.connect(port=self.stream_port, timeout_s=DEADLINE_S)

    def terminate(self, signal_number: signal.Signals = signal.SIGTERM) -> int:
        """Send a signal, and wait for the end of the process.

        Returns:
            The exit status.
        """
        self.process.send_signal(signal_number)
        return _wait_for_exit(self.process, self.log)


def write_small_robot(folder: Path) -> Path:
    """Write the bundled robot with a camera of 64 x 64 px and exact ground truth."""
    return write_edited_copy(
        OMNI_ROBOT,
        folder,
        Edit("ResolutionX=360", "ResolutionX=64"),
        Edit("ResolutionY=360", "ResolutionY=64"),
        Edit("Decimals=2", "Decimals=9"),
    )


@contextmanager
def start_server(
    folder: Path,
    *arguments: str,
    robot: Path | None = None,
    world: Path = FIELD,
    report_modules: Path | None = None,
    report_first_frame: Path | None = None,
) -> Iterator[RunningServer]:
    """Serve with a small camera for the length of a block.

    Args:
        folder: receives the robot file and server.log.
        arguments: further options of the command line.
        robot: the robot file; without one, that of `write_small_robot`.
        world: the world file.
        report_modules: receives a JSON list of the modules that the server loads once it serves
            the stream, at its end.
        report_first_frame: receives a JSON list of the modules that are loaded when the first
            client of the stream connects; what the server defers is loaded after that.
    """
    command = [
        *(SERVER_PYTHON, "-P", str(CHILD_SERVER)),
        *(("--report-modules", str(report_modules)) if report_modules else ()),
        *(("--report-first-frame", str(report_first_frame)) if report_first_frame else ()),
        *("--world", str(world)),
        *("--robot", str(robot or write_small_robot(folder))),
        *("--control-port", "0", "--image-port", "0"),
        # Tests of the page name its port; the others spare the time to load it.
        *(() if "--view" in arguments else ("--no-view",)),
        *("--renderer", "trace", "--threads", "1", *arguments),
    ]
    log = folder / "server.log"
    with (
        log.open("w") as log_file,
        # Closed when this process ends or Popen's block does: the signal to end for child_server.
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log_file, text=True
        ) as process,
    ):
        try:
            yield RunningServer(process, *_read_ports(process, log), log)
        finally:
            process.terminate()
            _wait_for_exit(process, log)


def _read_ports(process: subprocess.Popen[str], log: Path) -> tuple[int, int, int]:
    """Control, image and stream port, from the line that the server prints once it listens."""
    assert process.stdout is not None, "stdout is a pipe"
    # The line is written whole, so that one that has begun does not block.
    ready, _, _ = select.select([process.stdout], [], [], DEADLINE_S)
    assert ready, f"the server printed no ports within {DEADLINE_S:g} s:\n{log.read_text()}"
    found = LISTENING_PATTERN.fullmatch(process.stdout.readline())
    assert found, f"the server did not start:\n{log.read_text()}"
    control, image, stream = map(int, found.groups())
    return control, image, stream


def _wait_for_exit(process: subprocess.Popen[str], log: Path) -> int:
    try:
        return process.wait(DEADLINE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        raise AssertionError(
            f"the server did not end within {DEADLINE_S:g} s of a signal:\n{log.read_text()}"
        ) from None
