"""Blocking control connection over TCP: sends commands and waits for reports.

Nothing is read between calls. Reports that arrive while another is awaited are kept as the latest
of their type. The protocol itself is the sans-I/O `ControlClient`. How a TCP connection is opened,
for control and image port, and the address of a server as one value are here too.
"""

from __future__ import annotations

import logging
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.usarsim.commands import Command
from catoptra_protocol.usarsim.control_connection import ControlClient
from catoptra_protocol.usarsim.reports import Report


@dataclass(frozen=True, slots=True)
class ServerAddress:
    """Host and ports at which a server listens."""

    host: str
    control_port: int
    image_port: int
    stream_port: int | None = None
    """Port of the ZeroMQ stream; None where the caller uses TCP alone."""


def open_connection(host: str, port: int, timeout_s: float, *, server_kind: str) -> socket.socket:
    """Connect to the `control` or `image` port of a server.

    Raises:
        ConnectionLostError: nothing listens there; the message names the options to check.
    """
    try:
        connection = socket.create_connection((host, port), timeout=timeout_s)
    except OSError as error:
        raise ConnectionLostError(
            f"no {server_kind} server at {host}:{port} ({error}): start catoptra-server, and check "
            f"--host and --{server_kind}-port"
        ) from error
    # Commands are short: Nagle's algorithm would hold them until the last acknowledgement arrives.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def peer_address(connection: socket.socket) -> str:
    """Address of the peer as host:port, for messages."""
    host, port = connection.getpeername()[:2]
    return f"{host}:{port}"


_LOG = logging.getLogger(__name__)
_READ_BYTES = 64 * 1024

_ReportT = TypeVar("_ReportT", bound=Report)


class ReplyTimeoutError(ConnectionLostError):
    """The server is connected but did not send the expected report in time."""


class ControlConnection:
    """Connection to the control port, for one thread.

    Waiting raises ConnectionLostError if the server disconnects, ReplyTimeoutError if the expected
    report does not arrive in time, and RemoteProtocolError if the server violates the protocol.
    """

    def __init__(
        self, connection: socket.socket, *, timeout_s: float, clock: Callable[[], float]
    ) -> None:
        """Take ownership of a connected socket.

        Args:
            connection: connected TCP socket.
            timeout_s: default time limit of a wait.
            clock: monotonic clock in seconds, which measures the limits.
        """
        self._socket = connection
        self.peer = peer_address(connection)
        self.timeout_s = timeout_s
        self._clock = clock
        self._protocol = ControlClient()
        self._unread: deque[Report] = deque()
        self._latest: dict[type[object], Report] = {}

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    @property
    def latest_reports(self) -> tuple[Report, ...]:
        """Latest report of each type."""
        return tuple(self._latest.values())

    def get_latest(self, report_type: type[_ReportT]) -> _ReportT | None:
        """Latest report of a type; None before the first."""
        report = self._latest.get(report_type)
        return report if isinstance(report, report_type) else None

    def send(self, command: Command) -> None:
        """Send a command."""
        _LOG.debug("to %s: %s", self.peer, command)
        try:
            self._socket.sendall(self._protocol.send(command))
        except OSError as error:
            raise self._connection_lost_error(str(error)) from error

    def wait_for_report(
        self,
        report_type: type[_ReportT],
        description: str,
        predicate: Callable[[_ReportT], bool] = lambda report: True,
        timeout_s: float | None = None,
    ) -> _ReportT:
        """Next report of a type that satisfies a predicate.

        Args:
            report_type: class of the report.
            description: the expected report, in words, for the error message.
            predicate: further condition on the report.
            timeout_s: time limit; the connection's default if None.
        """

        def matches(report: Report) -> bool:
            return isinstance(report, report_type) and predicate(report)

        report = self.wait_until(matches, description, timeout_s)[-1]
        assert isinstance(report, report_type)  # by `matches`; for the type checker
        return report

    def wait_until(
        self, predicate: Callable[[Report], bool], description: str, timeout_s: float | None = None
    ) -> list[Report]:
        """Reports up to and including the first that satisfies the predicate."""
        deadline_s = self._clock() + (self.timeout_s if timeout_s is None else timeout_s)
        reports: list[Report] = []
        while True:
            # Reports behind the awaited one stay queued for the next call.
            while not self._unread:
                self._unread.extend(self._read_reports(deadline_s, description))
            reports.append(self._unread.popleft())
            if predicate(reports[-1]):
                return reports

    def _read_reports(self, deadline_s: float, description: str) -> list[Report]:
        """Reports in the next bytes, recorded as the latest of their types."""
        # First without new bytes: a malformed report raises an error, and the reports behind the
        # malformed one are still in the parser's buffer.
        reports = self._protocol.receive(b"") or self._protocol.receive(
            self._receive_bytes(deadline_s, description)
        )
        for report in reports:
            _LOG.debug("from %s: %s", self.peer, report)
            self._latest[type(report)] = report
        return reports

    def _receive_bytes(self, deadline_s: float, description: str) -> bytes:
        """Receive some bytes; an error names the expected report."""
        try:
            data = self._receive_before(deadline_s)
        except TimeoutError as error:
            raise ReplyTimeoutError(
                f"{self.peer} is connected but did not send {description}"
            ) from error
        except OSError as error:
            raise self._connection_lost_error(str(error)) from error
        if not data:
            raise self._connection_lost_error("the server closed the connection")
        return data

    def _receive_before(self, deadline_s: float) -> bytes:
        remaining_s = deadline_s - self._clock()
        # Checked before each read: a stream of other reports must not extend the limit, and a
        # timeout of 0 would switch the socket to non-blocking.
        if remaining_s <= 0.0:
            raise TimeoutError
        self._socket.settimeout(remaining_s)
        return self._socket.recv(_READ_BYTES)

    def _connection_lost_error(self, reason: str) -> ConnectionLostError:
        return ConnectionLostError(
            f"lost the control server at {self.peer}: {reason}. The server's log has the cause; "
            "connect and spawn again to continue"
        )
