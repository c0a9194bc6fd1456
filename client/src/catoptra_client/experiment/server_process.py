"""A server as a process of its own, on free ports of the loopback, ended when the block ends."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from catoptra_protocol.errors import CatoptraError

_LISTENING = re.compile(r"listening control=(\S+):(\d+) image=(\S+):(\d+) stream=\S+:(\d+)")
_ENDS_WITHIN_S = 10.0


@dataclass(frozen=True, slots=True)
class ServerAddress:
    """Where a server listens. stream_port: None where nobody said."""

    host: str
    control_port: int
    image_port: int
    stream_port: int | None = None


@contextmanager
def running_server(
    robot: Path, world: Path, *, seed: int, log: Path, extra: tuple[str, ...] = ()
) -> Iterator[ServerAddress]:
    """Start a lockstep server and yield its address; its log goes into a file.

    Raises CatoptraError with the log's last lines if it does not come up.
    """
    command = [
        *(sys.executable, "-m", "catoptra_server"),
        *("--robot", str(robot), "--world", str(world), "--clock", "lockstep"),
        *("--control-port", "0", "--image-port", "0", "--image-type", "RAW"),
        *("--seed", str(seed), *extra),
    ]
    with (
        log.open("w") as messages,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=messages, text=True) as process,
    ):
        try:
            yield _address(process, log)
        finally:
            process.terminate()
            try:
                process.wait(_ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()


def _address(process: subprocess.Popen[str], log: Path) -> ServerAddress:
    """Return the address that the server announces; its end of output means that it failed."""
    assert process.stdout is not None, "stdout is a pipe"
    for line in process.stdout:
        found = _LISTENING.match(line)
        if found:
            return ServerAddress(found[1], int(found[2]), int(found[4]), int(found[5]))
    tail = "\n".join(log.read_text().splitlines()[-5:])
    raise CatoptraError(f"the server did not start:\n{tail}")
