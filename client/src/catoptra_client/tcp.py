"""What the two TCP connections have in common: how they are opened, and what they are called."""

from __future__ import annotations

import socket

from catoptra_protocol.errors import ConnectionLostError


def open_connection(host: str, port: int, timeout_s: float, *, server_kind: str) -> socket.socket:
    """Return a connection to the `control` or `image` server. Raises ConnectionLostError."""
    try:
        connection = socket.create_connection((host, port), timeout=timeout_s)
    except OSError as error:
        raise ConnectionLostError(
            f"no {server_kind} server at {host}:{port} ({error}): start catoptra-server, and check "
            f"--host and --{server_kind}-port"
        ) from error
    # What a client sends is short and urgent: it must not wait for the last acknowledgement.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def peer_address(connection: socket.socket) -> str:
    """Return the other end as host:port, for messages."""
    host, port = connection.getpeername()[:2]
    return f"{host}:{port}"
