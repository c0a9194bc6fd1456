"""Both ends of a control connection, without a socket: bytes in, events out; message in, bytes out.

Neither end buffers more than one unfinished line and the messages of the last bytes, whatever the
peer sends.
"""

from __future__ import annotations

from collections import deque

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.usarsim.commands import Command, command_from_message, line_from_command
from catoptra_protocol.usarsim.grammar import Dialect, LineReader, parse_message
from catoptra_protocol.usarsim.reports import (
    Greeting,
    Report,
    line_from_report,
    report_from_message,
)


class ControlServer:
    """Server end of one connection.

    Commands are not checked against the state of the robot, which the simulation alone knows: a
    command that needs a robot before there is one, or a second INIT, has no effect there.
    """

    def __init__(self, dialect: Dialect = Dialect.UT2004) -> None:
        self._reader = LineReader()
        self._is_greeted = False
        # Of the reports only: commands are the same in both dialects.
        self._dialect = dialect

    def send(self, report: Report) -> bytes:
        """Encode a report; empty for a report that the dialect does not have.

        Raises:
            LocalProtocolError: The first report is not the greeting, or a later one is; or the
                report has no valid line.
        """
        if isinstance(report, Greeting) is self._is_greeted:
            state = "after" if self._is_greeted else "before"
            raise LocalProtocolError(
                f"{type(report).__name__} {state} the greeting: this comes first, and once"
            )
        # Encoded before the state changes: a greeting without a valid line has not been sent.
        line = line_from_report(report, self._dialect)
        self._is_greeted = True
        return line

    def receive(self, data: bytes) -> list[Command]:
        """Commands of these bytes, in order; lines that are none are dropped silently.

        Raises:
            LocalProtocolError: The greeting was not sent yet.
        """
        if not self._is_greeted:
            raise LocalProtocolError("greet the client before reading from it")
        commands = (command_from_message(parse_message(x)) for x in self._reader.receive(data))
        return [command for command in commands if command is not None]


class ControlClient:
    """Client end of one connection."""

    def __init__(self) -> None:
        self._reader = LineReader()
        self._lines: deque[str] = deque()

    def send(self, command: Command) -> bytes:
        """Encode a command.

        Raises:
            LocalProtocolError: A text would break the line.
        """
        return line_from_command(command)

    def receive(self, data: bytes) -> list[Report]:
        """Known reports of these bytes, in order; unknown ones are skipped.

        Raises:
            RemoteProtocolError: A report is malformed. The reports before it are returned
                first: then the next call, even without bytes, raises, and the one after it
                continues behind the malformed line.
        """
        self._lines.extend(self._reader.receive(data))
        reports: list[Report] = []
        while self._lines:
            try:
                report = report_from_message(parse_message(self._lines[0]))
            except RemoteProtocolError:
                # Reports before the malformed line must not be lost with the exception.
                if reports:
                    break
                self._lines.popleft()
                raise
            self._lines.popleft()
            if report is not None:
                reports.append(report)
        return reports
