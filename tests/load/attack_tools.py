"""Sockets of the attackers: connections without any protocol, floods and ZeroMQ peers.

An attacker is a blocking program in a process of its own (`attacker_process`). An error of a
socket is no fault of an attack: the server may refuse, close or reset; the attack begins again.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import zmq

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.requests import Request

HOST = "127.0.0.1"
# Of the honest client: attackers may know its name, which is in every frame of the stream.
HONEST_ROBOT = "Honest"
# Longer than any reply of a healthy server under attack: a lost reply stops an attack no longer.
TIMEOUT_S = 5.0
_READ_BYTES = 1 << 16
_ZERO_LINGER = struct.pack("ii", 1, 0)


@dataclass(frozen=True, slots=True)
class AttackedPorts:
    """Ports of the server under attack."""

    control: int
    image: int
    stream: int
    page: int

    def __iter__(self) -> Iterator[int]:
        return iter((self.control, self.image, self.stream, self.page))


def connect(port: int) -> socket.socket:
    """Connect a blocking socket."""
    return socket.create_connection((HOST, port), TIMEOUT_S)


def connect_robot(
    ports: AttackedPorts,
    name: str,
    *,
    class_name: str = "USARBot.OmniP2AT",
    location: str = "1.5,1.0,0",
) -> socket.socket:
    """Connect to the control port and send INIT, without waiting for a reply."""
    connection = connect(ports.control)
    connection.sendall(
        f"INIT {{ClassName {class_name}}} {{Name {name}}} {{Location {location}}}\r\n".encode()
    )
    return connection


def reset(connection: socket.socket) -> None:
    """Close with RST, as the kernel does for a killed process with unread bytes."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ZERO_LINGER)
    connection.close()


def flood(connection: socket.socket, blocks: Iterable[bytes]) -> None:
    """Send blocks as fast as the server reads, and discard all that it sends."""
    connection.setblocking(False)
    for block in blocks:
        rest = memoryview(block)
        while rest:
            readable, writable, _ = select.select([connection], [connection], [], TIMEOUT_S)
            if readable and not connection.recv(_READ_BYTES):
                return
            if writable:
                rest = rest[connection.send(rest) :]


def send_unread(connection: socket.socket, blocks: Iterable[bytes]) -> None:
    """Send blocks, read nothing; wait where the server reads no further."""
    connection.settimeout(None)
    for block in blocks:
        connection.sendall(block)


def hold_connections(ports: Iterable[int], count: int, first_bytes: bytes) -> Iterator[None]:
    """Keep a number of connections that send some bytes and then nothing, and replace ended ones.

    Args:
        ports: Ports, taken in turn.
        count: Number of connections.
        first_bytes: Sent once on each connection.

    Yields:
        Ten times a second, with as many connections as the server accepts.
    """
    turn = list(ports)
    held: list[socket.socket] = []
    while True:
        with contextlib.suppress(OSError):
            while len(held) < count:
                connection = connect(turn[len(held) % len(turn)])
                held.append(connection)
                connection.sendall(first_bytes)
        yield
        time.sleep(0.1)
        held = [connection for connection in held if _is_open(connection)]


def _is_open(connection: socket.socket) -> bool:
    connection.setblocking(False)
    try:
        is_open = bool(connection.recv(_READ_BYTES))
    except BlockingIOError:
        is_open = True
    except OSError:
        is_open = False
    if not is_open:
        connection.close()
    return is_open


class AttackingPeer:
    """A DEALER that may neglect its replies."""

    def __init__(self, dealer: zmq.Socket[bytes]) -> None:
        self.dealer = dealer

    def send(self, *requests: Request) -> None:
        """Send requests; zmq.Again where the server takes none for TIMEOUT_S."""
        for request in requests:
            self.dealer.send(bytes_from_message(request))

    def discard_replies(self) -> None:
        """Discard the replies that have arrived."""
        with contextlib.suppress(zmq.Again):
            while True:
                self.dealer.recv_multipart(zmq.NOBLOCK)

    def wait_for_replies(self, count: int) -> None:
        """Wait for a number of messages; zmq.Again after TIMEOUT_S without one."""
        for _ in range(count):
            self.dealer.recv_multipart()

    def flood(self, requests: Iterable[Request]) -> None:
        """Send requests as fast as the server takes them, and discard the replies."""
        for request in requests:
            self.send(request)
            self.discard_replies()


@contextmanager
def connect_peer(
    ports: AttackedPorts, *, identity: bytes = b"", receive_buffer: int = 0
) -> Iterator[AttackingPeer]:
    """Connect to the stream.

    Args:
        ports: Ports of the server.
        identity: ZeroMQ identity; empty: the server assigns one.
        receive_buffer: Bytes that the kernel buffers, and one message in ZeroMQ; 0: the defaults.
    """
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        dealer = context.socket(zmq.DEALER)
        dealer.set(zmq.LINGER, 0)
        dealer.set(zmq.SNDTIMEO, int(1000 * TIMEOUT_S))
        dealer.set(zmq.RCVTIMEO, int(1000 * TIMEOUT_S))
        if identity:
            dealer.set(zmq.IDENTITY, identity)
        if receive_buffer:
            dealer.set(zmq.RCVHWM, 1)
            dealer.set(zmq.RCVBUF, receive_buffer)
        dealer.connect(f"tcp://{HOST}:{ports.stream}")
        yield AttackingPeer(dealer)
    finally:
        context.destroy(linger=0)
