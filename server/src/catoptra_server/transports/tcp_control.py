"""The control port (TCP 3000): one connection is one robot."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence

from catoptra_protocol.wire.connection import ControlServer
from catoptra_protocol.wire.reports import Greeting, Report
from catoptra_server.simulation import Asked, Left, Request

log = logging.getLogger(__name__)

# A client that reads nothing: beyond the first bound it misses sensor cycles, beyond the second (it
# asks and asks and does not read the answers) it is cut off, so that it costs nobody else memory.
_SKIP_ABOVE_BYTES = 64 * 1024
_CUT_ABOVE_BYTES = 1024 * 1024
_READ_BYTES = 16 * 1024


class ControlClient:
    """One connection, as the simulation sees it: its methods may be called from any thread."""

    def __init__(self, writer: asyncio.StreamWriter, protocol: ControlServer) -> None:
        self._loop = asyncio.get_running_loop()
        self._writer = writer
        self._protocol = protocol
        self.peer = "{}:{}".format(*writer.get_extra_info("peername")[:2])

    def deliver(self, reports: Sequence[Report]) -> None:
        """Send reports as one piece: clients that read clumsily lose least that way."""
        self._loop.call_soon_threadsafe(self._send, tuple(reports))

    def refuse_init(self) -> None:
        """Let the client try INIT again. The protocol has no message for it: silence."""
        self._loop.call_soon_threadsafe(self._protocol.refuse_init)

    def _send(self, reports: Sequence[Report]) -> None:
        waiting = self._writer.transport.get_write_buffer_size()
        if self._writer.is_closing():
            return
        if waiting > _CUT_ABOVE_BYTES:
            log.warning("%s reads nothing: cut off with %d bytes waiting", self.peer, waiting)
            self._writer.transport.abort()
            return
        if waiting > _SKIP_ABOVE_BYTES and all(report.WORD in ("SEN", "STA") for report in reports):
            return
        data = b"".join(self._protocol.send(report) for report in reports)
        log.debug("to %s: %r", self.peer, data)
        self._writer.write(data)


async def serve_control(
    host: str, port: int, *, greeting: Greeting, post: Callable[[Request], None]
) -> asyncio.Server:
    """Listen for robots' controllers; everything that they ask is posted to the simulation."""

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        protocol = ControlServer()
        client = ControlClient(writer, protocol)
        log.info("controller %s connected", client.peer)
        try:
            writer.write(protocol.send(greeting))
            while data := await reader.read(_READ_BYTES):
                log.debug("from %s: %r", client.peer, data)
                for command in protocol.receive(data):
                    post(Asked(client, command))
        except ConnectionError as error:
            log.info("controller %s broke off: %s", client.peer, error)
        finally:
            post(Left(client))
            writer.close()
            log.info("controller %s gone", client.peer)

    return await asyncio.start_server(converse, host, port)
