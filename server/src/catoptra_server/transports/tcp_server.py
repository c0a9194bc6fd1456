"""A TCP server that ends with certainty: all its connections end too, whatever their peers do.

An asyncio server alone leaves its connections open, and from Python 3.12 on waits for their peers.
"""

from __future__ import annotations

import asyncio
import logging
import weakref
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

ConnectionHandler = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]

log = logging.getLogger(__name__)


@asynccontextmanager
async def serve_tcp(
    host: str, port: int, handler: ConnectionHandler, *, max_connections: int | None = None
) -> AsyncIterator[asyncio.Server]:
    """Run a handler for every connection until the block ends.

    A connection ends when its handler returns or the connection breaks; bytes written before are
    still sent.

    Args:
        host: Host name or address of the interface.
        port: TCP port; 0 = a free one.
        handler: Coroutine of one connection.
        max_connections: Limit of concurrent connections; further ones are closed at once. None
            = unlimited.

    Raises:
        OSError: The port is not available.
    """
    tasks: set[asyncio.Task[None]] = set()
    # A closed connection counts too, until its peer has read the bytes written before.
    transports: weakref.WeakSet[asyncio.WriteTransport] = weakref.WeakSet()

    async def handle_connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None, "a coroutine runs in a task"
        if max_connections is not None and len(tasks) >= max_connections:
            limit = "%s rejected: the limit of %d connections is reached"
            log.warning(limit, peer_name(writer), max_connections)
            writer.close()
            return
        tasks.add(task)
        transports.add(writer.transport)
        try:
            await handler(reader, writer)
        except OSError as error:
            log.info("%s disconnected: %s", peer_name(writer), error)
        except asyncio.CancelledError:
            # The block ends; Python 3.11 would log a cancelled task as a failure.
            pass
        except Exception:
            # The top of a task; before Python 3.11.3 asyncio would not report the exception.
            log.exception("connection of %s failed: a bug in the server", peer_name(writer))
        finally:
            tasks.discard(task)
            writer.close()

    server = await asyncio.start_server(handle_connection, host, port)
    try:
        yield server
    finally:
        server.close()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for transport in transports:
            transport.abort()


def peer_name(writer: asyncio.StreamWriter) -> str:
    """Address of the other end, for logs."""
    return "{}:{}".format(*writer.get_extra_info("peername")[:2])
