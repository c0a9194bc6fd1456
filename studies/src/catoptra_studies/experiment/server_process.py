"""A server as a process of its own, on free ports of the loopback, ended when the block ends."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from catoptra_client.server_address import ServerAddress
from catoptra_protocol.errors import CatoptraError

_LISTENING_PATTERN = re.compile(r"listening control=(\S+):(\d+) image=(\S+):(\d+) stream=\S+:(\d+)")
_TERMINATE_TIMEOUT_S = 10.0


@contextmanager
def run_server(
    robot_file: Path,
    world_file: Path,
    *,
    seed: int,
    log_file: Path,
    extra_arguments: tuple[str, ...] = (),
) -> Iterator[ServerAddress]:
    """Start a lockstep server and yield its address; its log goes into a file.

    Raises CatoptraError with the log's last lines if it does not come up.
    """
    command = [
        *(sys.executable, "-m", "catoptra_server"),
        *("--robot", str(robot_file), "--world", str(world_file), "--clock", "lockstep"),
        *("--control-port", "0", "--image-port", "0", "--image-type", "RAW"),
        *("--seed", str(seed), *extra_arguments),
    ]
    with (
        log_file.open("w") as messages,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=messages, text=True) as process,
    ):
        try:
            yield _read_address(process, log_file)
        finally:
            process.terminate()
            try:
                process.wait(_TERMINATE_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()


def _read_address(process: subprocess.Popen[str], log_file: Path) -> ServerAddress:
    """Return the address that the server announces; its end of output means that it failed."""
    assert process.stdout is not None, "stdout is a pipe"
    for line in process.stdout:
        found = _LISTENING_PATTERN.match(line)
        if found:
            return ServerAddress(found[1], int(found[2]), int(found[4]), int(found[5]))
    tail = "\n".join(log_file.read_text().splitlines()[-5:])
    raise CatoptraError(f"the server did not start:\n{tail}")
