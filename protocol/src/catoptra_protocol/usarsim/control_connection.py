"""Both ends of a control connection, without a socket: bytes in, events out; message in, bytes out.

Neither end buffers more than one unfinished line and the messages of the last bytes, whatever the
peer sends.
"""

from __future__ import annotations

from collections import deque

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.usarsim.commands import Command, command_from_message, line_from_command
from catoptra_protocol.usarsim.control_states import TRANSITIONS, ControlState
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.grammar import LineReader, parse_message
from catoptra_protocol.usarsim.reports import (
    Greeting,
    Report,
    line_from_report,
    report_from_message,
)


class ControlServer:
    """Server end of one connection, which is one robot."""

    def __init__(self, dialect: Dialect = Dialect.UT2004) -> None:
        self._reader = LineReader()
        self._state = ControlState.ACCEPTED
        # Of the reports only: commands are the same in both dialects.
        self._dialect = dialect

    @property
    def state(self) -> ControlState:
        """State of the connection."""
        return self._state

    def send(self, report: Report) -> bytes:
        """Encode a report; empty for a report that the dialect does not have.

        Raises:
            LocalProtocolError: The first report is not the greeting, or a later one is; or the
                report has no valid line.
        """
        if isinstance(report, Greeting) is not (self._state is ControlState.ACCEPTED):
            raise LocalProtocolError(
                f"{type(report).__name__} in state {self._state.name}: the greeting comes first, "
                "and once"
            )
        # Encoded before the state changes: a greeting that has no valid line leaves the state
        # ACCEPTED.
        line = line_from_report(report, self._dialect)
        if self._state is ControlState.ACCEPTED:
            self._state = ControlState.GREETED
        return line

    def receive(self, data: bytes) -> list[Command]:
        """Commands to execute, in order; all others are dropped silently.

        Raises:
            LocalProtocolError: The greeting was not sent yet.
        """
        if self._state is ControlState.ACCEPTED:
            raise LocalProtocolError("greet the client before reading from it")
        # A generator: each command is checked against the state that its predecessor left, so that
        # commands in the segment of an INIT find the robot.
        commands = (command_from_message(parse_message(x)) for x in self._reader.receive(data))
        return [
            command for command in commands if command is not None and self._advance_state(command)
        ]

    def reject_init(self) -> None:
        """Record that no robot was spawned, so that the client may INIT again.

        Raises:
            LocalProtocolError: No INIT is pending.
        """
        if self._state is not ControlState.SPAWNED:
            raise LocalProtocolError(f"there is no pending INIT in state {self._state.name}")
        self._state = ControlState.GREETED

    def _advance_state(self, command: Command) -> bool:
        """Enter the state that follows a command; False if the command is not accepted now."""
        after = TRANSITIONS[self._state].get(type(command))
        self._state = after or self._state
        return after is not None


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
