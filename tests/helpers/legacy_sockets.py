"""Blocking sockets of legacy clients, each with a read size of its own."""

from __future__ import annotations

import socket
import struct

from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S

_ZERO_LINGER = struct.pack("ii", 1, 0)


def connect(port: int) -> socket.socket:
    """Connect with DEADLINE_S as the timeout of every operation."""
    return socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S)


def receive(connection: socket.socket, size: int) -> bytes:
    """Bytes of one recv; ConnectionError if the server has closed the connection."""
    try:
        data = connection.recv(size)
    except TimeoutError:
        raise AssertionError(f"no data from the server within {DEADLINE_S:g} s") from None
    if not data:
        raise ConnectionError("the server closed the connection")
    return data


def receive_exactly(connection: socket.socket, size: int) -> bytes:
    """A number of bytes, whatever the segments."""
    data = b""
    while len(data) < size:
        data += receive(connection, size - len(data))
    return data


def reset_connection(connection: socket.socket) -> None:
    """Close with RST, as the kernel does for a killed process with unread bytes."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ZERO_LINGER)
    connection.close()


class LineSocket:
    """Lines of a server, read `size` bytes at a time and split at LF, without CR."""

    def __init__(self, port: int, *, size: int) -> None:
        self.connection = connect(port)
        self._size = size
        self._rest = b""

    def __enter__(self) -> LineSocket:
        return self

    def __exit__(self, *error: object) -> None:
        self.connection.close()

    def send(self, text: str) -> None:
        """Send text in one segment."""
        self.connection.sendall(text.encode("ascii"))

    def read_line(self) -> str:
        """Next line, not parsed."""
        while b"\n" not in self._rest:
            self._rest += receive(self.connection, self._size)
        line, _, self._rest = self._rest.partition(b"\n")
        return line.rstrip(b"\r").decode("ascii")

    def read_line_starting_with(self, prefix: str) -> str:
        """Next line that starts with a prefix; the lines before are discarded."""
        deadline = Deadline(f"line that starts with {prefix!r}", DEADLINE_S)
        while not (line := self.read_line()).startswith(prefix):
            deadline.check()
        return line
