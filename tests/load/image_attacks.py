"""Attacks on the image port, and on all ports alike: idle, leaving and garbage connections.

Each function attacks until the server ends the connection; `attacker_process` calls it again.
"""

from __future__ import annotations

import contextlib
import random
import time
from itertools import cycle, repeat

from catoptra_protocol.stream.requests import GetLandmarksRequest, GetStatusRequest
from load.attack_tools import (
    HONEST_ROBOT,
    AttackedPorts,
    connect,
    connect_peer,
    flood,
    hold_connections,
    reset,
    send_unread,
)

# More than the default limit of the image port, and than `ulimit -n 300` has descriptors.
_IDLE_CONNECTIONS = 320


def idle_on_images(ports: AttackedPorts) -> None:
    """Keep idle connections on the image port, and request landmarks meanwhile.

    A server that loads modules at the first request for landmarks finds no descriptor then.
    """
    with connect_peer(ports) as peer:
        # The stream's connection is made at once, while there is a descriptor for it.
        peer.send(GetStatusRequest(1))
        peer.wait_for_replies(1)
        held = hold_connections([ports.image], _IDLE_CONNECTIONS, b"")
        for id_, _ in enumerate(held, 2):
            peer.send(GetLandmarksRequest(id_, HONEST_ROBOT, ""))
            peer.discard_replies()


def hold_half_requests(ports: AttackedPorts) -> None:
    """Keep connections on all ports that never complete their first request."""
    for _ in hold_connections(ports, 90, b"\xff\x00O"):
        pass


def request_unread_frames(ports: AttackedPorts) -> None:
    """Request frames without end, and read none."""
    with connect(ports.image) as connection:
        send_unread(connection, repeat(b"OK" * 2000))


def leave_while_waiting(ports: AttackedPorts) -> None:
    """Request a frame and leave, with FIN and RST in turn."""
    for has_reset in cycle((False, True)):
        connection = connect(ports.image)
        connection.sendall(b"OK")
        if has_reset:
            reset(connection)
        else:
            connection.close()


def storm_connections(ports: AttackedPorts) -> None:
    """Connect to each port in turn and disconnect at once."""
    for number, port in enumerate(cycle(ports)):
        connection = connect(port)
        if number % 2:
            reset(connection)
        else:
            connection.close()


def post_as_a_page(ports: AttackedPorts) -> None:
    """POST commands to control and image port, as a page of another site has a browser do."""
    body = (
        b"INIT {ClassName USARBot.OmniP2AT} {Location 2,1,0}\r\nDRIVE {Left 5} {Right 5}\r\nOK\r\n"
    )
    head = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: %d\r\n\r\n" % len(body)
    while True:
        for port in (ports.control, ports.image):
            with connect(port) as connection, contextlib.suppress(OSError):
                connection.sendall(head + body)
                connection.recv(1024)
        time.sleep(0.02)


def send_garbage(ports: AttackedPorts) -> None:
    """Send random bytes to all ports, each until the server ends the connection."""
    random_bytes = random.Random(13)
    for port in cycle(ports):
        with contextlib.suppress(OSError), connect(port) as connection:
            flood(connection, (random_bytes.randbytes(4096) for _ in range(64)))
        time.sleep(0.01)
