"""Server of the control port (TCP 3000): one connection is one robot."""

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

# Bounds on the unsent bytes of a client that does not read: above the first its periodic reports
# are dropped, above the second (it sends queries without reading the replies) it is disconnected,
# so that memory stays bounded.
_DROP_PERIODIC_ABOVE_BYTES = 64 * 1024
_DISCONNECT_ABOVE_BYTES = 1024 * 1024
_READ_BYTES = 16 * 1024
# Reports that are repeated in the next cycle.
_PERIODIC_WORDS = ("SEN", "STA", "MISSTA")


class ControlPeer:
    """One connection as a client of the simulation; its methods may be called from any thread."""

    def __init__(self, writer: asyncio.StreamWriter, protocol: ControlServer) -> None:
        self._loop = asyncio.get_running_loop()
        self._writer = writer
        self._protocol = protocol
        self.address = peer_name(writer)

    def deliver(self, reports: Sequence[Report]) -> None:
        """Send reports."""
        self._loop.call_soon_threadsafe(self._send, tuple(reports))

    def reject_init(self) -> None:
        """Let the client try INIT again; the protocol has no message for a rejection."""
        self._loop.call_soon_threadsafe(self._protocol.reject_init)

    def _send(self, reports: Sequence[Report]) -> None:
        unsent = self._writer.transport.get_write_buffer_size()
        if self._writer.is_closing():
            return
        if unsent > _DISCONNECT_ABOVE_BYTES:
            log.warning("%s reads nothing: disconnected, %d bytes unsent", self.address, unsent)
            self._writer.transport.abort()
            return
        is_periodic = all(report.WORD in _PERIODIC_WORDS for report in reports)
        if unsent > _DROP_PERIODIC_ABOVE_BYTES and is_periodic:
            return
        # One write for all: clients that read line by line from one segment lose least that way.
        data = b"".join(map(self._encode, reports))
        log.debug("to %s: %r", self.address, data)
        self._writer.write(data)

    def _encode(self, report: Report) -> bytes:
        """Bytes of a report; empty for an invalid one, so that the others are sent."""
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
    """Serve controllers of robots until the block ends.

    Args:
        host: Host name or address of the interface.
        port: TCP port; 0 = a free one.
        greeting: First line on each connection.
        post: Hands an event to the simulation; thread-safe.
        dialect: Dialect of the reports.
        max_connections: Limit of concurrent connections; None = unlimited.

    Raises:
        OSError: The port is not available.
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
            # Whatever ended the connection, also an exception: the robot must not stay in the
            # world.
            post(ClientDisconnected(client))
            log.info("controller %s disconnected", client.address)

    return serve_tcp(host, port, handle_connection, max_connections=max_connections)
