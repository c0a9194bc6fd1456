"""The control port (TCP 3000): one connection is one robot."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.wire.connection import ControlServer
from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.reports import Greeting, Report
from catoptra_server.simulation import Asked, Left, Request
from catoptra_server.transports.listening import listening, peer_name

log = logging.getLogger(__name__)

# A client that reads nothing: beyond the first bound it misses sensor cycles, beyond the second (it
# asks and asks and does not read the answers) it is cut off, so that it costs nobody else memory.
_SKIP_ABOVE_BYTES = 64 * 1024
_CUT_ABOVE_BYTES = 1024 * 1024
_READ_BYTES = 16 * 1024
_PERIODIC = ("SEN", "STA", "MISSTA")  # what comes again by itself


class ControlClient:
    """One connection, as the simulation sees it: its methods may be called from any thread."""

    def __init__(self, writer: asyncio.StreamWriter, protocol: ControlServer) -> None:
        self._loop = asyncio.get_running_loop()
        self._writer = writer
        self._protocol = protocol
        self.peer = peer_name(writer)

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
        if waiting > _SKIP_ABOVE_BYTES and all(report.WORD in _PERIODIC for report in reports):
            return
        data = b"".join(map(self._bytes, reports))
        log.debug("to %s: %r", self.peer, data)
        self._writer.write(data)

    def _bytes(self, report: Report) -> bytes:
        """Return a report's bytes; none of one that cannot be sent, so that the others can."""
        try:
            return self._protocol.send(report)
        except LocalProtocolError as error:
            log.error("not sent to %s: %s", self.peer, error)
            return b""


def serve_control(
    host: str,
    port: int,
    *,
    greeting: Greeting,
    post: Callable[[Request], None],
    dialect: Dialect = Dialect.UT2004,
    most: int | None = None,
) -> AbstractAsyncContextManager[asyncio.Server]:
    """Listen for robots' controllers; everything that they ask is posted to the simulation.

    most: of them at once; None = any number.
    """

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        protocol = ControlServer(dialect)
        client = ControlClient(writer, protocol)
        log.info("controller %s connected", client.peer)
        try:
            writer.write(protocol.send(greeting))
            while data := await reader.read(_READ_BYTES):
                log.debug("from %s: %r", client.peer, data)
                for command in protocol.receive(data):
                    post(Asked(client, command))
        finally:
            post(Left(client))
            log.info("controller %s gone", client.peer)

    return listening(host, port, converse, most=most)
