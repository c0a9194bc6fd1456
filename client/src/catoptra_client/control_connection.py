"""A control connection that waits: commands out, and reports in until what is wanted has come.

Nothing is read between calls; what comes on the way is kept as the newest of its kind. A thin shell
around the sans-I/O `ControlClient`.
"""

from __future__ import annotations

import logging
import socket
from collections import deque
from collections.abc import Callable
from typing import TypeVar

from catoptra_client.tcp import peer_address
from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.usarsim.commands import Command
from catoptra_protocol.usarsim.control_connection import ControlClient
from catoptra_protocol.usarsim.reports import Report

_LOG = logging.getLogger(__name__)
_READ_BYTES = 64 * 1024

_ReportT = TypeVar("_ReportT", bound=Report)


class ReplyTimeoutError(ConnectionLostError):
    """The server is there but did not send what was asked for in time."""


class ControlConnection:
    """One connection, for one thread.

    Waiting raises ConnectionLostError if the server goes away, ReplyTimeoutError if what is wanted does
    not come in time, and RemoteProtocolError if it sends what no server of ours would.
    """

    def __init__(
        self, connection: socket.socket, *, timeout_s: float, clock: Callable[[], float]
    ) -> None:
        """Take over a connected socket. `clock` counts seconds and measures the timeouts."""
        self._socket = connection
        self.peer = peer_address(connection)
        self.timeout_s = timeout_s
        self._clock = clock
        self._protocol = ControlClient()
        self._unread: deque[Report] = deque()
        self._latest: dict[type[object], Report] = {}

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    @property
    def latest_reports(self) -> tuple[Report, ...]:
        """Return the newest report of each kind."""
        return tuple(self._latest.values())

    def get_latest(self, report_type: type[_ReportT]) -> _ReportT | None:
        """Return the newest report of a kind that was read; None before the first."""
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
        """Return the next report of a type that is accepted; `what` is named where none comes."""

        def matches(report: Report) -> bool:
            return isinstance(report, report_type) and predicate(report)

        found = self.wait_until(matches, description, timeout_s)[-1]
        assert isinstance(found, report_type)
        return found

    def wait_until(
        self, predicate: Callable[[Report], bool], description: str, timeout_s: float | None = None
    ) -> list[Report]:
        """Return the reports up to the first wanted one, which is the last of them."""
        deadline_s = self._clock() + (self.timeout_s if timeout_s is None else timeout_s)
        reports: list[Report] = []
        while True:
            while not self._unread:
                self._unread.extend(self._read_reports(deadline_s, description))
            reports.append(self._unread.popleft())
            if predicate(reports[-1]):
                return reports

    def _read_reports(self, deadline_s: float, description: str) -> list[Report]:
        """Return what the next bytes say, having noted it as the newest of its kind."""
        # Without bytes: what the last ones held behind a malformed report, if there was one.
        reports = self._protocol.receive(b"") or self._protocol.receive(
            self._receive_bytes(deadline_s, description)
        )
        for report in reports:
            _LOG.debug("from %s: %s", self.peer, report)
            self._latest[type(report)] = report
        return reports

    def _receive_bytes(self, deadline_s: float, description: str) -> bytes:
        """Return some bytes of the server; an error tells what was waited for."""
        try:
            data = self._receive_before(deadline_s)
        except TimeoutError as error:
            raise ReplyTimeoutError(
                f"{self.peer} is connected but did not send {description}"
            ) from error
        except OSError as error:
            raise self._connection_lost_error(str(error)) from error
        if not data:
            raise self._connection_lost_error("it closed the connection")
        return data

    def _receive_before(self, deadline_s: float) -> bytes:
        left_s = deadline_s - self._clock()
        if left_s <= 0.0:  # other reports can stream in for ever
            raise TimeoutError
        self._socket.settimeout(left_s)
        return self._socket.recv(_READ_BYTES)

    def _connection_lost_error(self, reason: str) -> ConnectionLostError:
        return ConnectionLostError(
            f"lost the control server at {self.peer}: {reason}. Its log tells why; "
            "connect and spawn again to go on"
        )
