"""A control connection as lines of text, not parsed."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S

# Legacy clients read into buffers of 4096 bytes.
_MAX_LINE_BYTES = 4095


class ControlLines:
    """One connection; the end and the length of each received line are checked."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._received = b""

    def send(self, *lines: str) -> None:
        """Send lines in one segment."""
        self._connection.sendall("".join(f"{line}\r\n" for line in lines).encode())

    def read_line(self) -> str:
        """Next line without its end."""
        while b"\n" not in self._received:
            data = self._connection.recv(65536)
            assert data, "the server closed the connection"
            self._received += data
        line, _, self._received = self._received.partition(b"\n")
        assert line.endswith(b"\r")
        assert len(line) + 1 <= _MAX_LINE_BYTES, line[:80]
        return line[:-1].decode("latin-1")

    def read_until(self, prefix: str) -> list[str]:
        """Lines up to and including the first that starts with a prefix."""
        lines = [self.read_line()]
        deadline = Deadline(f"line that starts with {prefix!r}", DEADLINE_S)
        while not lines[-1].startswith(prefix):
            deadline.check()
            lines.append(self.read_line())
        return lines

    def step(self, time_s: float) -> list[str]:
        """Advance a lockstep server; return the lines up to the RES, which is checked."""
        self.send(f"STEP {{Time {time_s}}}")
        *lines, result = self.read_until("RES")
        assert result.endswith("{Status OK}")
        return lines


@contextmanager
def connect_control_lines(port: int) -> Iterator[ControlLines]:
    """Connect to a control port, and read the greeting."""
    with socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S) as connection:
        lines = ControlLines(connection)
        assert lines.read_line().startswith("NFO ")
        yield lines
