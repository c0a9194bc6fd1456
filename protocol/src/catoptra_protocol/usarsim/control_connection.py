"""Both ends of a control connection, without a socket: bytes in, events out; message in, bytes out.

Neither keeps more than one unfinished line and what the last bytes said, whatever the peer sends.
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
    """The server's end of one connection, which is one robot."""

    def __init__(self, dialect: Dialect = Dialect.UT2004) -> None:
        self._reader = LineReader()
        self._state = ControlState.ACCEPTED
        self._dialect = dialect

    @property
    def state(self) -> ControlState:
        """Return where the connection stands."""
        return self._state

    def send(self, report: Report) -> bytes:
        """Return the bytes of a report: none of one on which the dialect is silent.

        The first one, and only that, must be the greeting.
        """
        if isinstance(report, Greeting) is not (self._state is ControlState.ACCEPTED):
            raise LocalProtocolError(
                f"{type(report).__name__} in state {self._state.name}: the greeting comes first, "
                "and once"
            )
        line = line_from_report(report, self._dialect)
        if self._state is ControlState.ACCEPTED:
            self._state = ControlState.GREETED
        return line

    def receive(self, data: bytes) -> list[Command]:
        """Return the commands to serve, in order; all others are dropped in silence."""
        if self._state is ControlState.ACCEPTED:
            raise LocalProtocolError("greet the client before reading from it")
        commands = (command_from_message(parse_message(x)) for x in self._reader.receive(data))
        return [
            command for command in commands if command is not None and self._advance_state(command)
        ]

    def reject_init(self) -> None:
        """Tell that no robot was spawned (unknown class or start): the client may INIT again."""
        if self._state is not ControlState.SPAWNED:
            raise LocalProtocolError(f"there is no INIT to refuse in state {self._state.name}")
        self._state = ControlState.GREETED

    def _advance_state(self, command: Command) -> bool:
        after = TRANSITIONS[self._state].get(type(command))
        self._state = after or self._state
        return after is not None


class ControlClient:
    """The client's end of one connection."""

    def __init__(self) -> None:
        self._reader = LineReader()
        self._lines: deque[str] = deque()

    def send(self, command: Command) -> bytes:
        """Return the bytes of a command. Raises LocalProtocolError for text that would break it."""
        return line_from_command(command)

    def receive(self, data: bytes) -> list[Report]:
        """Return the reports that we know, in order; others are skipped.

        Raises RemoteProtocolError for a malformed one, but first returns those before it: the next
        call, even with no bytes, raises, and the one after it goes on behind the malformed line.
        """
        self._lines.extend(self._reader.receive(data))
        reports: list[Report] = []
        while self._lines:
            try:
                report = report_from_message(parse_message(self._lines[0]))
            except RemoteProtocolError:
                if reports:
                    break
                self._lines.popleft()
                raise
            self._lines.popleft()
            if report is not None:
                reports.append(report)
        return reports
