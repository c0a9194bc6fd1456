"""Attacks on the control port: floods of lines, churn of robots, places far outside the world.

Each function attacks until the server ends the connection; `attacker_process` calls it again.
"""

from __future__ import annotations

import contextlib
import socket
import time
from itertools import count, cycle, repeat

from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding
from load.attack_tools import (
    AttackedPorts,
    connect,
    connect_peer,
    connect_robot,
    flood,
    reset,
    send_unread,
)

# All robots of the churn spawn here: the place is never free.
CHURN_LOCATION = "-1.5,1.0,0"
# The length limit of a line (SPEC.md 3) less its word.
_LONG = 65000


def flood_scans(ports: AttackedPorts) -> None:
    """Request scans of a range scanner without pause, and read the replies."""
    line = b"SET {Type RangeScanner} {Opcode SCAN}\r\n"
    with connect_robot(ports, "Scans", class_name="USARBot.P2AT") as connection:
        flood(connection, repeat(line * 500))


def flood_failed_scans(ports: AttackedPorts) -> None:
    """Request scans of a robot without a scanner: every reply is a failure."""
    line = b"SET {Type RangeScanner} {Opcode SCAN}\r\n"
    with connect_robot(ports, "NoScans") as connection:
        flood(connection, repeat(line * 500))


def flood_drives(ports: AttackedPorts) -> None:
    """Change the speed of the wheels without pause."""
    lines = b"".join(b"DRIVE {Left %d} {Right 1}\r\n" % (i % 3) for i in range(900))
    with connect_robot(ports, "Drives", location="1.5,-1.0,0") as connection:
        flood(connection, repeat(lines))


def flood_multidrives(ports: AttackedPorts) -> None:
    """Send MULTIDRIVE lines of almost 64 kB."""
    blocks = b"".join(b" {J%d 1.5}" % i for i in range(6000))
    line = b"MULTIDRIVE" + blocks[:_LONG].rpartition(b" ")[0] + b"\r\n"
    with connect_robot(ports, "Joints", location="1.5,0,0") as connection:
        flood(connection, repeat(line))


def flood_steps(ports: AttackedPorts) -> None:
    """Send 2000 steps of a minute each, and leave."""
    with connect_robot(ports, "Steps", location="2.0,0.5,0") as connection:
        connection.sendall(b"STEP {Time 60}\r\n" * 2000)
    time.sleep(0.5)


def churn_spawns(ports: AttackedPorts) -> None:
    """Connect, spawn a robot at one place, and leave."""
    for number in count():
        connection = connect_robot(ports, f"Churn{number % 7}", location=CHURN_LOCATION)
        connection.recv(4096)
        if number % 2:
            reset(connection)
        else:
            connection.close()


def stack_robots(ports: AttackedPorts) -> None:
    """Spawn sixteen robots at one place, and request frames of the first."""
    with contextlib.ExitStack() as held, connect_peer(ports) as peer:
        for number in range(16):
            robot = connect_robot(ports, f"Stacked{number}", location=CHURN_LOCATION)
            held.enter_context(robot)
        for id_ in count(1):
            peer.send(GetFrameRequest(id_, "Stacked0", "", ImageEncoding.RAW))
            peer.wait_for_replies(1)


def spawn_far_away(ports: AttackedPorts) -> None:
    """Spawn at places beyond the range of cell indices and of floats, drive, request frames."""
    for number, place in enumerate(cycle(("1e308,0,0", "1e19,0,0", "-1e19,1e30,1e308"))):
        name = f"Far{number % 3}"
        with connect_robot(ports, name, location=place) as connection, connect_peer(ports) as peer:
            connection.sendall(b"DRIVE {Left 1} {Right 1}\r\n")
            peer.send(GetFrameRequest(1, name, "", ImageEncoding.RAW))
            with connect(ports.image) as viewer:
                viewer.sendall(b"OK")
                time.sleep(0.2)


def query_unread(ports: AttackedPorts) -> None:
    """Query configurations, and read none of the replies."""
    with connect_robot(ports, "Unread", location="2.0,1.5,0") as connection:
        send_unread(connection, repeat(b"GETCONF {Type Camera}\r\n" * 500))


def send_malformed_lines(ports: AttackedPorts) -> None:
    """Send lines that are no commands, or almost."""
    lines = (
        b"{" * _LONG,
        b"DRIVE {Left " + b"1" * _LONG + b"}",
        b"DRIVE {Left 1e400} {Right nan} {Left inf}",
        b"INIT {ClassName \x1b[2J\x00\x07} {Name \r} {Location ,,,}",
        b"INIT {ClassName USARBot.OmniP2AT} {Name \x1b]0;title\x07} {Location 1e400,nan,-}",
        b"SET {Type Camera} {Opcode MaxError} {Params " + b"9" * 400 + b"}",
        b"SET {Type " + b"T" * _LONG + b"}",
        b"GETCONF {Type Camera} {Name " + b"\xff" * 400 + b"}",
        b" ".join(b"{a%d}" % i for i in range(9000)),
        b"STEP {Time -1e308}",
        bytes(range(256)),
    )
    with connect(ports.control) as connection:
        flood(connection, (line + b"\r\n" for line in cycle(lines)))


def send_unterminated_lines(ports: AttackedPorts) -> None:
    """Send blocks of 64 kB without a line end."""
    with connect(ports.control) as connection:
        flood(connection, repeat(b"DRIVE {Left 1.0} " * 4096))


def close_halfway(ports: AttackedPorts) -> None:
    """Request something, end the sending direction at once, and keep the connection."""
    requests = (
        (ports.control, b"GETSTARTPOSES\r\n"),
        (ports.control, b"INIT {ClassName USARBot.OmniP2AT} {Location 2.2,1.8,0}\r\n"),
        (ports.image, b"OKOKOK"),
    )
    held = []
    for _, (port, request) in zip(range(60), cycle(requests), strict=False):
        connection = connect(port)
        held.append(connection)
        connection.sendall(request)
        connection.shutdown(socket.SHUT_WR)
    time.sleep(2.0)
    for connection in held:
        connection.close()
