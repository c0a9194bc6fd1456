"""A real server process on free ports, killed by a watchdog where it hangs."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.robot_client import RobotClient
from helpers.configs import FIELD, OMNI_ROBOT, Edit, write_edited_copy

# Only a broken test waits so long.
DEADLINE_S = 60.0
LISTENING_PATTERN = re.compile(
    r"listening control=127\.0\.0\.1:(\d+) image=127\.0\.0\.1:(\d+) stream=127\.0\.0\.1:(\d+)\n"
)


@dataclass(frozen=True, slots=True)
class RunningServer:
    """A server that listens."""

    process: subprocess.Popen[str]
    control_port: int
    image_port: int
    stream_port: int
    log: Path

    def connect_robot(self) -> RobotClient:
        """Return a connection to the control port."""
        return RobotClient.connect(port=self.control_port, timeout_s=DEADLINE_S)

    def connect_images(self) -> ImageClient:
        """Return a connection to the image port."""
        return ImageClient.connect(port=self.image_port, timeout_s=DEADLINE_S)

    def connect_stream(self) -> StreamClient:
        """Return a connection to the stream."""
        return StreamClient.connect(port=self.stream_port, timeout_s=DEADLINE_S)

    def terminate(self, signal_number: signal.Signals = signal.SIGTERM) -> int:
        """Send a signal; return the exit status."""
        self.process.send_signal(signal_number)
        return self.process.wait(DEADLINE_S)


def write_small_robot(folder: Path) -> Path:
    """Write the shipped robot with a picture of 64 x 64 px and exact ground truth."""
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
    timeout_s: float = DEADLINE_S,
) -> Iterator[RunningServer]:
    """Start a server with a small picture; end it with the block if it still runs.

    within_s: how long only a broken test takes.
    """
    command = [
        *(sys.executable, "-m", "catoptra_server", "--world", str(world)),
        *("--robot", str(robot or write_small_robot(folder))),
        *("--control-port", "0", "--image-port", "0"),
        *("--renderer", "trace", "--threads", "1", *arguments),
    ]
    log = folder / "server.log"
    with (
        log.open("w") as messages,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=messages, text=True) as process,
    ):
        watchdog = threading.Timer(timeout_s, process.kill)
        watchdog.start()
        try:
            assert process.stdout is not None, "stdout is a pipe"
            found = LISTENING_PATTERN.fullmatch(process.stdout.readline())
            assert found, f"the server did not start:\n{log.read_text()}"
            yield RunningServer(process, *map(int, found.groups()), log)
        finally:
            process.terminate()
            process.wait(DEADLINE_S)
            watchdog.cancel()
