"""One connection to a control port with all its lines, for the checks of this port.

Lines are kept with their ends and their times of arrival, and parsed on demand: the checks look at
text as well as at meaning. Nothing here assumes our own server.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from catoptra_protocol.usarsim.grammar import Message, parse_message
from conformance.check import (
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    rejection_of_recording,
)

# Robots of every known server report at least every 0.5 s; ten times as long on a busy machine.
REPORT_TIMEOUT_S = 5.0
_READ_BYTES = 64 * 1024
# Reports that were computed before a command may still arrive for as long as this.
_IN_FLIGHT_S = 0.05


@dataclass(frozen=True, slots=True)
class ReceivedLine:
    """A line of the server."""

    data: bytes
    """With its end."""
    received_s: float
    """Monotonic time."""
    message: Message

    @property
    def text(self) -> str:
        """Line without its end."""
        return self.data.rstrip(b"\r\n").decode("latin-1")

    def with_text(self, text: str) -> ReceivedLine:
        """The line with another text, at the same time; its end is added if it has none."""
        data = (text if text.endswith("\n") else f"{text}\r\n").encode("latin-1")
        return ReceivedLine(data, self.received_s, parse_message(text.rstrip("\r\n")))

    @property
    def sensor_type(self) -> str:
        """Type of a SEN line in lower case; empty for other lines."""
        return (self.message.get("Type") or "").lower() if self.message.word == "SEN" else ""


@dataclass(slots=True)
class ControlSession:
    """An open connection."""

    connection: socket.socket
    dialect: str
    lines: list[ReceivedLine] = field(default_factory=list)
    _rest: bytes = b""

    def send(self, *commands: str) -> None:
        """Send commands in one segment."""
        self.connection.sendall("".join(f"{one}\r\n" for one in commands).encode("latin-1"))

    def read_until(self, is_complete: Callable[[], bool], timeout_s: float) -> bool:
        """Receive lines until a condition holds; whether it did before the timeout.

        Raises:
            CheckFailed: The server closed the connection.
        """
        deadline_s = time.monotonic() + timeout_s
        while not is_complete():
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                return False
            self._read(left_s)
        return True

    def read_for(self, duration_s: float) -> list[ReceivedLine]:
        """Lines of the next seconds."""
        first = len(self.lines)
        self.read_until(lambda: False, duration_s)
        return self.lines[first:]

    def query(self, *commands: str) -> list[Message]:
        """CONF, GEO and RES replies to commands; none where the server has no such part.

        Replies come in the order of their commands, so that the one to GETSTARTPOSES ends them:
        servers of UDK have no reply at all for a part that does not exist.
        """
        first = len(self.lines)
        self.send(*commands, "GETSTARTPOSES")
        self.read_until(
            lambda: any(_is_start_poses(line) for line in self.lines[first:]), REPORT_TIMEOUT_S
        )
        messages = (line.message for line in self.lines[first:])
        return [message for message in messages if message.word in ("CONF", "GEO", "RES")]

    def read_next_cycle(self) -> dict[str, list[Message]]:
        """Newest report of each sensor type, measured after all commands up to now.

        Of a type with a line for each sensor (UDK) the newest line of each name.
        """
        types = {line.sensor_type for line in self.lines} - {""}
        start_s = time.monotonic() + _IN_FLIGHT_S
        self.read_until(
            lambda: types <= {line.sensor_type for line in self._lines_since(start_s)},
            REPORT_TIMEOUT_S,
        )
        newest: dict[str, dict[str, Message]] = {}
        for line in self._lines_since(start_s):
            names = newest.setdefault(line.sensor_type, {})
            # In UT2004 the block of a name holds all pairs of the sensor.
            names[(line.message.get("Name") or "").partition(" ")[0]] = line.message
        return {type_: list(names.values()) for type_, names in newest.items() if type_}

    def _lines_since(self, start_s: float) -> list[ReceivedLine]:
        return [line for line in self.lines if line.received_s >= start_s]

    def _read(self, timeout_s: float) -> None:
        self.connection.settimeout(max(timeout_s, 1e-3))
        try:
            data = self.connection.recv(_READ_BYTES)
        except TimeoutError:
            return
        if not data:
            raise CheckFailed("the server closed the connection")
        *ended, self._rest = (self._rest + data).split(b"\n")
        now_s = time.monotonic()
        for line in ended:
            text = line.rstrip(b"\r").decode("latin-1")
            if reason := rejection_of_recording(text):
                raise CheckSkipped(reason)
            message = parse_message(text)
            self.lines.append(ReceivedLine(line + b"\n", now_s, message))


@contextmanager
def connect_control(server: ServerUnderTest) -> Iterator[ControlSession]:
    """Connect to the control port for the length of a block."""
    address = server.addresses["control"]
    with socket.create_connection(address, timeout=REPORT_TIMEOUT_S) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield ControlSession(connection, server.dialect)


@contextmanager
def spawn_robot(server: ServerUnderTest, pose: str | None = None) -> Iterator[ControlSession]:
    """Spawn a robot for the length of a block; its first cycle of reports has arrived.

    Args:
        server: Server.
        pose: Blocks of INIT with the pose; None: the server's spawn pose.

    Raises:
        CheckFailed: No report arrived.
    """
    init = f"INIT {{ClassName {server.robot_class}}} {pose or server.spawn_pose}"
    with connect_control(server) as session:
        # A reply to this connection: the server has dealt with the end of earlier ones, whose
        # robots would be in the way.
        session.query()
        session.send(init)
        if not session.read_until(lambda: _has_status(session), REPORT_TIMEOUT_S):
            raise CheckFailed(f"{init}: no SEN and STA within {REPORT_TIMEOUT_S:g} s")
        yield session


def _has_status(session: ControlSession) -> bool:
    """Whether readings and a status have arrived, in any order."""
    return {"SEN", "STA"} <= {line.message.word for line in session.lines}


def _is_start_poses(line: ReceivedLine) -> bool:
    return line.message.word == "NFO" and line.message.get("StartPoses") is not None
