"""A control connection in lines, as an old client sees it: nothing is interpreted."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from helpers.server_process import DEADLINE_S

# Clients read into buffers of 4096 bytes.
_MAX_LINE_BYTES = 4095


class ControlLines:
    """One connection: lines out, lines in; each that comes in is checked for its end and length."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._received = b""

    def send(self, *lines: str) -> None:
        """Send lines in one segment."""
        self._connection.sendall("".join(f"{line}\r\n" for line in lines).encode())

    def read_line(self) -> str:
        """Return the next line without its end."""
        while b"\n" not in self._received:
            data = self._connection.recv(65536)
            assert data, "the server closed the connection"
            self._received += data
        line, _, self._received = self._received.partition(b"\n")
        assert line.endswith(b"\r")
        assert len(line) + 1 <= _MAX_LINE_BYTES, line[:80]
        return line[:-1].decode("latin-1")

    def read_until(self, prefix: str) -> list[str]:
        """Return the lines up to one that begins so, which is the last."""
        lines = [self.read_line()]
        while not lines[-1].startswith(prefix):
            lines.append(self.read_line())
        return lines

    def step(self, time_s: float) -> list[str]:
        """Let time pass on a lockstep server; return what it tells but for the RES."""
        self.send(f"STEP {{Time {time_s}}}")
        *told, result = self.read_until("RES")
        assert result.endswith("{Status OK}")
        return told


@contextmanager
def connect_control_lines(port: int) -> Iterator[ControlLines]:
    """Connect to a control port, and read the greeting."""
    with socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S) as connection:
        lines = ControlLines(connection)
        assert lines.read_line().startswith("NFO ")
        yield lines
