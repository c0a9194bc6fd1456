"""Sockets as old clients use them: blocking, read in the pieces that each is used to."""

from __future__ import annotations

import socket
import struct

from helpers.server_process import DEADLINE_S

_ZERO_LINGER = struct.pack("ii", 1, 0)


def connect(port: int) -> socket.socket:
    """Return a connection on which a broken test ends, if late."""
    return socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S)


def receive(connection: socket.socket, size: int) -> bytes:
    """Return what one recv gives. Raises ConnectionError if the server has closed."""
    data = connection.recv(size)
    if not data:
        raise ConnectionError("the server closed the connection")
    return data


def receive_exactly(connection: socket.socket, size: int) -> bytes:
    """Return so many bytes, however they are cut."""
    data = b""
    while len(data) < size:
        data += receive(connection, size - len(data))
    return data


def reset_connection(connection: socket.socket) -> None:
    """Break the connection off with RST, as a process that is killed with unread bytes."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ZERO_LINGER)
    connection.close()


class LineSocket:
    """Lines of a server, read `size` bytes at a time and cut at LF; CR is stripped.

    What most clients do, with sizes of their own. Nothing is parsed here.
    """

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
        """Return the next line."""
        while b"\n" not in self._rest:
            self._rest += receive(self.connection, self._size)
        line, _, self._rest = self._rest.partition(b"\n")
        return line.rstrip(b"\r").decode("ascii")

    def read_line_starting_with(self, prefix: str) -> str:
        """Return the next line that starts so."""
        while not (line := self.read_line()).startswith(prefix):
            pass
        return line
