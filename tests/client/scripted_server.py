"""Loopback server that plays a script in a thread, through the sans-I/O core.

A script is a function of a connected socket; an exception in the script is raised again in the
test.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from catoptra_protocol.usarsim.commands import Command
from catoptra_protocol.usarsim.control_connection import ControlServer
from catoptra_protocol.usarsim.image_port import ImageRequest, ImageRequestReader
from catoptra_protocol.usarsim.reports import Greeting, Report

Script = Callable[[socket.socket], None]
GREETING = Greeting("BotDeathMatch", "field")
DEADLINE_S = 10.0  # only a broken test waits so long


@contextmanager
def serve_script(script: Script) -> Iterator[int]:
    """Serve one connection with the script; yield the port."""
    failures: list[BaseException] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(DEADLINE_S)
        thread = threading.Thread(target=_run_script, args=(listener, script, failures))
        thread.start()
        yield listener.getsockname()[1]
        thread.join(DEADLINE_S)
    if failures:
        raise failures[0]
    assert not thread.is_alive()


def _run_script(listener: socket.socket, script: Script, failures: list[BaseException]) -> None:
    try:
        connection, _ = listener.accept()
        with connection:
            connection.settimeout(DEADLINE_S)
            script(connection)
    except BaseException as error:
        failures.append(error)


class ScriptedControlPeer:
    """The server's end of a control connection, for scripts."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._protocol = ControlServer()
        self._commands: list[Command] = []
        self.send(GREETING)

    def send(self, *reports: Report) -> None:
        """Send reports as one segment."""
        self._socket.sendall(b"".join(map(self._protocol.send, reports)))

    def receive_command(self) -> Command:
        """Next command of the client."""
        while not self._commands:
            self._commands += self._protocol.receive(_receive(self._socket))
        return self._commands.pop(0)


class ScriptedImagePeer:
    """The server's end of an image connection, for scripts."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._reader = ImageRequestReader()
        self._requests: list[ImageRequest] = []

    def send(self, data: bytes) -> None:
        """Send bytes."""
        self._socket.sendall(data)

    def receive_request(self) -> ImageRequest:
        """Next request of the client."""
        while not self._requests:
            self._requests += self._reader.receive(_receive(self._socket))
        return self._requests.pop(0)


def wait_for_close(connection: socket.socket) -> None:
    """Read until the client has closed."""
    while connection.recv(4096):
        pass


def _receive(connection: socket.socket) -> bytes:
    data = connection.recv(4096)
    assert data, "the client closed while the script waited for it"
    return data
