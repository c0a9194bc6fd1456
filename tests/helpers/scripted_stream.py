"""A stream server in a thread, with the replies of a test."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zmq

from catoptra_protocol.stream.messages import SCHEMA_VERSION, bytes_from_message, request_from_bytes
from catoptra_protocol.stream.replies import Heartbeat
from catoptra_protocol.stream.requests import Request

HEARTBEAT = bytes_from_message(Heartbeat(SCHEMA_VERSION))
# Messages to send in reply to a request, each a list of parts.
Script = Callable[[Request], list[list[bytes]]]
_POLL_INTERVAL_MS = 20


@contextmanager
def serve_stream_script(
    script: Script, *, port: int = 0, sends_heartbeats: bool = False
) -> Iterator[int]:
    """Serve a script on the loopback.

    Args:
        script: Replies to a request, each a list of parts.
        port: TCP port; 0 = a free one.
        sends_heartbeats: Whether all clients receive heartbeats continuously.

    Yields:
        The port.
    """
    context = zmq.Context()
    router = context.socket(zmq.ROUTER)
    router.bind(f"tcp://127.0.0.1:{port or '*'}")
    bound = int(router.get_string(zmq.LAST_ENDPOINT).rpartition(":")[2])
    stopped = threading.Event()
    failures: list[BaseException] = []

    def run() -> None:
        try:
            _serve(router, script, sends_heartbeats, stopped)
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield bound
    finally:
        stopped.set()
        thread.join()
        context.destroy(linger=0)
    # The cause of a failed script, rather than only the client's timeout.
    if failures:
        raise failures[0]


def _serve(
    router: zmq.Socket[bytes], script: Script, sends_heartbeats: bool, stopped: threading.Event
) -> None:
    known: set[bytes] = set()
    while not stopped.is_set():
        if router.poll(_POLL_INTERVAL_MS):
            peer, data = router.recv_multipart()
            known.add(peer)
            for parts in script(request_from_bytes(data)):
                router.send_multipart([peer, *parts])
        for peer in known if sends_heartbeats else ():
            router.send_multipart([peer, HEARTBEAT])
