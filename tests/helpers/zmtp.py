"""ZMTP 3 as the bytes of a DEALER, for peers that violate the protocol as ZeroMQ never does."""

from __future__ import annotations

import contextlib
import socket

from helpers.loopback import DEADLINE_S, HOST

MORE, LONG, COMMAND = 1, 2, 4
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01" + b"NULL".ljust(20, b"\0") + bytes(32)


def zmtp_frame(body: bytes, flags: int = 0) -> bytes:
    """A ZMTP frame, with a length field of eight bytes if flags has LONG, else of one byte."""
    return bytes([flags]) + len(body).to_bytes(8 if flags & LONG else 1, "big") + body


READY = zmtp_frame(b"\x05READY\x0bSocket-Type\0\0\0\x06DEALER", COMMAND)


def connect_with_handshake(port: int) -> socket.socket:
    """Connect a blocking socket, and complete the handshake."""
    peer = socket.create_connection((HOST, port), DEADLINE_S)
    peer.sendall(GREETING + READY)
    received = b""
    while b"ROUTER" not in received:
        data = peer.recv(1024)
        assert data, "the ROUTER ended the handshake"
        received += data
    return peer


def send_until_disconnect(port: int, block: bytes, *, max_bytes: int) -> int:
    """Send a block repeatedly; number of bytes sent before the connection was closed."""
    with connect_with_handshake(port) as peer:
        return send_until_closed(peer, block, max_bytes=max_bytes)


def send_until_closed(peer: socket.socket, block: bytes, *, max_bytes: int = 1 << 40) -> int:
    """Send a block repeatedly, and read nothing; number of bytes until the peer closed."""
    sent = 0
    with contextlib.suppress(ConnectionError):
        while sent < max_bytes:
            sent += peer.send(block)
    return sent
