"""A control server of another maker: a thread that replies to lines by a script."""

from __future__ import annotations

import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Reply = Callable[[str], str]
"""Lines that a command is answered by, with their ends; empty for none."""


@contextmanager
def serve_control_script(reply: Reply) -> Iterator[tuple[str, int]]:
    """Serve connections for the length of a block; each is greeted.

    Args:
        reply: Function from a command, without its end, to the reply.

    Yields:
        Address of the server.
    """

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            self.wfile.write(b"NFO {Gametype BotDeathMatch} {Level Other} {TimeLimit 0}\r\n")
            for line in self.rfile:
                self.wfile.write(reply(line.decode("latin-1").strip()).encode("latin-1"))

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield "127.0.0.1", server.server_address[1]
        finally:
            server.shutdown()
            thread.join()
