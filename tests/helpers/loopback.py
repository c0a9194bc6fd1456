"""Scenes on an asyncio loop with sockets of the loopback: ended by a limit, never by patience."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Coroutine
from typing import Any

HOST = "127.0.0.1"
# Only a broken test waits so long.
DEADLINE_S = 20.0
# A peer that reads nothing fills these and what the server's kernel keeps.
SMALL_BUFFER_BYTES = 4096

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


def run_scenario(scenario: Coroutine[Any, Any, None]) -> None:
    """Run a scene; fail where it hangs."""

    async def main() -> None:
        await asyncio.wait_for(scenario, DEADLINE_S)

    asyncio.run(main())


def listening_port(server: asyncio.Server) -> int:
    """Return the port that a server listens on."""
    port: int = server.sockets[0].getsockname()[1]
    return port


async def connect(server: asyncio.Server) -> Streams:
    """Return a connection to a server."""
    return await asyncio.open_connection(HOST, listening_port(server))


async def connect_without_reading(server: asyncio.Server) -> socket.socket:
    """Return a connection whose end reads nothing and keeps little."""
    end = socket.socket()
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
    end.setblocking(False)
    await asyncio.get_running_loop().sock_connect(end, (HOST, listening_port(server)))
    return end


def abort(writer: asyncio.StreamWriter) -> None:
    """Break a connection off, as a process that is killed does."""
    writer.transport.abort()
