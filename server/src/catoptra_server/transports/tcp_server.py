"""A listening port whose end is certain: with it ends every connection, whatever its peer does.

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
    """Hold a conversation with everyone who connects, until the block ends.

    A conversation ends when it returns or its connection breaks; what was written to it is still
    sent. most: conversations at once; a connection beyond them is closed without a word. Raises
    OSError if the port cannot be had.
    """
    tasks: set[asyncio.Task[None]] = set()
    # A closed connection still counts while its peer has not read what was written to it.
    transports: weakref.WeakSet[asyncio.WriteTransport] = weakref.WeakSet()

    async def handle_connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None, "a coroutine runs in a task"
        if max_connections is not None and len(tasks) >= max_connections:
            log.warning("%s sent away: %d are served, no more", peer_name(writer), max_connections)
            writer.close()
            return
        tasks.add(task)
        transports.add(writer.transport)
        try:
            await handler(reader, writer)
        except OSError as error:  # a reset, a time-out, a host that cannot be reached any more
            log.info("%s broke off: %s", peer_name(writer), error)
        except asyncio.CancelledError:
            pass  # the block ends; Python 3.11 would log a cancelled task as a fault
        except Exception:  # the top of a task; before Python 3.11.3 asyncio would tell nobody
            log.exception("the conversation with %s failed: a fault of ours", peer_name(writer))
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
    """Return the other end's address, for logs."""
    return "{}:{}".format(*writer.get_extra_info("peername")[:2])
