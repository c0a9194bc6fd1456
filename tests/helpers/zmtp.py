"""What a DEALER writes to its connection, byte by byte: for peers that ZeroMQ would not be."""

from __future__ import annotations

import socket

from helpers.loopback import DEADLINE_S, HOST

MORE, LONG, COMMAND = 1, 2, 4
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01" + b"NULL".ljust(20, b"\0") + bytes(32)


def zmtp_frame(body: bytes, flags: int = 0) -> bytes:
    """Return a frame with a length of one byte, or of eight where flags say so."""
    return bytes([flags]) + len(body).to_bytes(8 if flags & LONG else 1, "big") + body


READY = zmtp_frame(b"\x05READY\x0bSocket-Type\0\0\0\x06DEALER", COMMAND)


def connect_with_handshake(port: int) -> socket.socket:
    """Return a blocking connection on which both sides have said READY."""
    peer = socket.create_connection((HOST, port), DEADLINE_S)
    peer.sendall(GREETING + READY)
    heard = b""
    while b"ROUTER" not in heard:
        data = peer.recv(1024)
        assert data, "the ROUTER ended the handshake"
        heard += data
    return peer


def send_until_disconnect(port: int, block: bytes, *, max_bytes: int) -> int:
    """Send a block again and again; return how many bytes went until the connection was ended."""
    sent = 0
    with connect_with_handshake(port) as peer:
        try:
            while sent < max_bytes:
                sent += peer.send(block)
        except ConnectionError:
            pass
    return sent
