"""The control port (TCP 3000): one connection is one robot."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.control_connection import ControlServer
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.reports import Greeting, Report
from catoptra_server.simulation import ClientDisconnected, CommandReceived, SimulationEvent
from catoptra_server.transports.tcp_server import peer_name, serve_tcp

log = logging.getLogger(__name__)

# A client that reads nothing: beyond the first bound it misses sensor cycles, beyond the second (it
# asks and asks and does not read the answers) it is cut off, so that it costs nobody else memory.
_DROP_PERIODIC_ABOVE_BYTES = 64 * 1024
_DISCONNECT_ABOVE_BYTES = 1024 * 1024
_READ_BYTES = 16 * 1024
_PERIODIC_WORDS = ("SEN", "STA", "MISSTA")  # what comes again by itself


class ControlPeer:
    """One connection, as the simulation sees it: its methods may be called from any thread."""

    def __init__(self, writer: asyncio.StreamWriter, protocol: ControlServer) -> None:
        self._loop = asyncio.get_running_loop()
        self._writer = writer
        self._protocol = protocol
        self.address = peer_name(writer)

    def deliver(self, reports: Sequence[Report]) -> None:
        """Send reports as one piece: clients that read clumsily lose least that way."""
        self._loop.call_soon_threadsafe(self._send, tuple(reports))

    def reject_init(self) -> None:
        """Let the client try INIT again. The protocol has no message for it: silence."""
        self._loop.call_soon_threadsafe(self._protocol.reject_init)

    def _send(self, reports: Sequence[Report]) -> None:
        waiting = self._writer.transport.get_write_buffer_size()
        if self._writer.is_closing():
            return
        if waiting > _DISCONNECT_ABOVE_BYTES:
            log.warning("%s reads nothing: cut off with %d bytes waiting", self.address, waiting)
            self._writer.transport.abort()
            return
        if waiting > _DROP_PERIODIC_ABOVE_BYTES and all(
            report.WORD in _PERIODIC_WORDS for report in reports
        ):
            return
        data = b"".join(map(self._encode, reports))
        log.debug("to %s: %r", self.address, data)
        self._writer.write(data)

    def _encode(self, report: Report) -> bytes:
        """Return a report's bytes; none of one that cannot be sent, so that the others can."""
        try:
            return self._protocol.send(report)
        except LocalProtocolError as error:
            log.error("not sent to %s: %s", self.address, error)
            return b""


def serve_control(
    host: str,
    port: int,
    *,
    greeting: Greeting,
    post: Callable[[SimulationEvent], None],
    dialect: Dialect = Dialect.UT2004,
    max_connections: int | None = None,
) -> AbstractAsyncContextManager[asyncio.Server]:
    """Listen for robots' controllers; everything that they ask is posted to the simulation.

    most: of them at once; None = any number.
    """

    async def handle_connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        protocol = ControlServer(dialect)
        client = ControlPeer(writer, protocol)
        log.info("controller %s connected", client.address)
        try:
            writer.write(protocol.send(greeting))
            while data := await reader.read(_READ_BYTES):
                log.debug("from %s: %r", client.address, data)
                for command in protocol.receive(data):
                    post(CommandReceived(client, command))
        finally:
            post(ClientDisconnected(client))
            log.info("controller %s gone", client.address)

    return serve_tcp(host, port, handle_connection, max_connections=max_connections)
