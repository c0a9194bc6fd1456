"""A server as a process of its own, on the loopback interface, and its stream once it replies."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError, ConnectionLostError

_LISTENING_PATTERN = re.compile(r"listening control=(\S+):(\d+) image=(\S+):(\d+) stream=\S+:(\d+)")
_PAGE_PATTERN = re.compile(r"live page: (\S+)")
_TERMINATE_TIMEOUT_S = 10.0

# Receives the link of a server's live page.
PageCallback = Callable[[str], None]


def can_start_server() -> bool:
    """Whether a server can be started with this interpreter."""
    # Found, not imported: a client never loads the server's code.
    return importlib.util.find_spec("catoptra_server") is not None


@contextmanager
def run_server(
    robot_file: Path,
    world_file: Path,
    *,
    seed: int,
    log_file: Path,
    extra_arguments: tuple[str, ...] = (),
    on_page: PageCallback | None = None,
) -> Iterator[ServerAddress]:
    """Start a lockstep server for the block, on free ports.

    Args:
        robot_file: Robot file, or the name of a bundled one.
        world_file: World file, or the name of a bundled one.
        seed: Seed of the server's random numbers.
        log_file: File for the server's log.
        extra_arguments: Further arguments of catoptra-server.
        on_page: As in `start_server`.

    Yields:
        The server's address.

    Raises:
        CatoptraError: No server is installed, or it ended before it listened.
    """
    # Lockstep, so that the same commands give the same bytes on a slow machine; free ports, so that
    # set-ups and tests can run side by side; raw images, so that no coder adds noise.
    arguments = (
        *("--robot", str(robot_file), "--world", str(world_file), "--clock", "lockstep"),
        *("--control-port", "0", "--image-port", "0", "--image-type", "RAW"),
        *("--seed", str(seed), *extra_arguments),
    )
    with start_server(arguments, log_file=log_file, on_page=on_page) as address:
        yield address


@contextmanager
def serve_stream(
    robot_file: Path,
    world_file: Path,
    *,
    seed: int,
    timeout_s: float,
    extra_arguments: tuple[str, ...] = (),
) -> Iterator[StreamClient]:
    """Start a lockstep server for the block, with a temporary log, and connect to its stream.

    Args:
        robot_file: As in `run_server`, like all others.
        world_file: World file.
        seed: Seed of the server's random numbers.
        timeout_s: Longest wait for the stream, and the timeout of the client's calls.
        extra_arguments: Further arguments of catoptra-server.

    Yields:
        The connected client.

    Raises:
        CatoptraError: No server is installed, it ended early, or its stream does not reply.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        run_server(
            robot_file,
            world_file,
            seed=seed,
            log_file=Path(folder, "server.log"),
            extra_arguments=extra_arguments,
        ) as address,
        connect_stream(address, timeout_s=timeout_s) as client,
    ):
        yield client


@contextmanager
def start_server(
    arguments: tuple[str, ...], *, log_file: Path, on_page: PageCallback | None = None
) -> Iterator[ServerAddress]:
    """Start a server process for the block; it ends with this program, also with a killed one.

    Args:
        arguments: Arguments of catoptra-server.
        log_file: File for the server's log.
        on_page: Receives the link of the live page, from another thread; None serves no page.

    Yields:
        The server's address.

    Raises:
        CatoptraError: No server is installed, or it ended before it listened.
    """
    if not can_start_server():
        raise CatoptraError(
            "no server is installed here: pip install catoptra-server, or name the address of a "
            "running one"
        )
    view = ("--no-view",) if on_page is None else ()
    command = [sys.executable, "-m", "catoptra_client.child_server", *arguments, *view]
    with (
        log_file.open("w") as log,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True
        ) as process,
    ):
        try:
            address = _read_address(process, log_file)
            # In a thread, so that a page that is served late delays nobody.
            reader = threading.Thread(target=_read_page_link, args=(process, on_page), daemon=True)
            reader.start()
            yield address
        finally:
            # The server ends in order on SIGTERM; only one that hangs is killed.
            process.terminate()
            try:
                process.wait(_TERMINATE_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
        # Its pipe has ended with the process; Popen closes it next.
        reader.join()


def connect_stream(
    address: ServerAddress,
    *,
    timeout_s: float,
    clock: Callable[[], float] = time.monotonic,
) -> StreamClient:
    """Connect to the stream of a server that may have just started.

    Args:
        address: Server with a stream port.
        timeout_s: Longest wait, and the timeout of the client's calls.
        clock: Source of the time in seconds.

    Raises:
        ConnectionLostError: The server did not reply in time.
    """
    assert address.stream_port is not None, "the caller's server has a stream"
    deadline_s = clock() + timeout_s
    while True:
        try:
            return StreamClient.connect(address.host, address.stream_port, timeout_s)
        except ConnectionLostError:
            # Its port listens before the modules behind it are loaded: on a busy machine the first
            # reply comes later than a heartbeat should.
            if clock() >= deadline_s:
                raise


def _read_address(process: subprocess.Popen[str], log_file: Path) -> ServerAddress:
    """Read the address that the server prints once all its ports are open."""
    assert process.stdout is not None, "stdout is a pipe"
    for line in process.stdout:
        match = _LISTENING_PATTERN.match(line)
        if match:
            return ServerAddress(match[1], int(match[2]), int(match[4]), int(match[5]))
    # The end of the output without that line: the reason is in the last lines of the log.
    tail = "\n".join(log_file.read_text().splitlines()[-5:])
    raise CatoptraError(f"the server did not start:\n{tail}")


def _read_page_link(process: subprocess.Popen[str], on_page: PageCallback | None) -> None:
    """Read the rest of the output, in which the link of the page follows the address."""
    assert process.stdout is not None, "stdout is a pipe"
    for line in process.stdout:
        match = _PAGE_PATTERN.match(line)
        if match and on_page:
            on_page(match[1])
