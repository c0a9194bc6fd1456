"""Scenarios on an asyncio loop with sockets of the loopback, each wait with a deadline of its own.

A scenario is a coroutine that plays clients against a server in the same process. It has no time
limit as a whole: a slow machine takes longer, and that is no failure. A single wait that makes no
progress for DEADLINE_S fails the test with the line that waits.
"""

from __future__ import annotations

import asyncio
import linecache
import socket
import struct
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Protocol

import pytest

from helpers.deadline import Deadline

HOST = "127.0.0.1"
# Some hundred times the longest wait that was measured on two busy cores.
DEADLINE_S = 60.0
_POLL_S = 0.5
_TESTS = Path(__file__).parents[1]
# A peer that reads nothing fills these and the buffers of the server's kernel.
SMALL_BUFFER_BYTES = 4096

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]
# File and line of a suspended coroutine.
Location = tuple[str, int]


def run_scenario(scenario: Coroutine[Any, Any, None]) -> None:
    """Run a scenario to its end; fail where one of its waits exceeds DEADLINE_S."""

    async def main() -> None:
        task = asyncio.ensure_future(scenario)
        waiting_at, waited_s = _waiting_line(task), 0.0
        while not (await asyncio.wait({task}, timeout=_POLL_S))[0]:
            line = _waiting_line(task)
            waited_s = waited_s + _POLL_S if line == waiting_at else 0.0
            waiting_at = line
            if waited_s >= DEADLINE_S:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
                pytest.fail(f"no progress for {DEADLINE_S:g} s in {_describe(line)}")
        task.result()

    asyncio.run(main())


def _waiting_line(task: asyncio.Task[None]) -> Location:
    """Innermost line of the tests at which a task is suspended.

    `Task.get_stack` stops at the outermost coroutine of a suspended task, so the chain of awaited
    coroutines is followed here; frames of libraries are passed over.
    """
    coroutine: Any = task.get_coro()
    innermost = ("", 0)
    while (frame := getattr(coroutine, "cr_frame", None)) is not None:
        if Path(frame.f_code.co_filename).is_relative_to(_TESTS):
            innermost = (frame.f_code.co_filename, frame.f_lineno)
        coroutine = coroutine.cr_await
    return innermost


def _describe(location: Location) -> str:
    file, line = location
    return f"{Path(file).name}:{line}: {linecache.getline(file, line).strip()}"


async def wait_until(condition: Callable[[], bool], event: str) -> None:
    """Let the other tasks run until a condition holds; fail after DEADLINE_S."""
    deadline = Deadline(event, DEADLINE_S)
    while not condition():
        deadline.check()
        await asyncio.sleep(0)


def listening_port(server: asyncio.Server) -> int:
    """Port on which a server listens."""
    port: int = server.sockets[0].getsockname()[1]
    return port


class ListeningServer(Protocol):
    """A server of this project."""

    @property
    def port(self) -> int:
        """TCP port on which it listens."""


async def connect(server: ListeningServer) -> Streams:
    """Connect to a server."""
    return await asyncio.open_connection(HOST, server.port)


async def connect_without_reading(server: ListeningServer) -> socket.socket:
    """Connect with a socket that reads nothing and has a small receive buffer."""
    end = socket.socket()
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
    end.setblocking(False)
    await asyncio.get_running_loop().sock_connect(end, (HOST, server.port))
    return end


def abort(writer: asyncio.StreamWriter) -> None:
    """Reset a connection, as the kernel does for a killed process with unread bytes."""
    end = writer.get_extra_info("socket")
    end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    writer.transport.abort()
