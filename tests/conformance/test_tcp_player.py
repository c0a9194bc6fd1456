"""The player of the two TCP ports against servers that misbehave."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from conformance.conversation_file import Conversation
from conformance.tcp_player import play_conversation


@contextmanager
def closing_server() -> Iterator[tuple[str, int]]:
    """Accept one connection, send one line and close the connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.sendall(b"NFO {Gametype A} {Level B} {TimeLimit 0}\r\n")

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()
        thread.join()


def test_play_when_the_server_closes_reports_the_step() -> None:
    steps = ({"expect": ["NFO .*"]}, {"expect": ["STA .*"]})
    with closing_server() as address:
        reason = play_conversation(Conversation("c", "", "control", True, steps), address, {})
    assert reason == "step 2 (expect): the server closed the connection"
