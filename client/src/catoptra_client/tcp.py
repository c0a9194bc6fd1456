"""TCP helpers shared by the control and the image connection."""

from __future__ import annotations

import socket

from catoptra_protocol.errors import ConnectionLostError


def open_connection(host: str, port: int, timeout_s: float, *, server_kind: str) -> socket.socket:
    """Connect to the `control` or `image` port of a server.

    Raises:
        ConnectionLostError: nothing listens there; the message names the options to check.
    """
    try:
        connection = socket.create_connection((host, port), timeout=timeout_s)
    except OSError as error:
        raise ConnectionLostError(
            f"no {server_kind} server at {host}:{port} ({error}): start catoptra-server, and check "
            f"--host and --{server_kind}-port"
        ) from error
    # Commands are short: Nagle's algorithm would hold them until the last acknowledgement arrives.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def peer_address(connection: socket.socket) -> str:
    """Address of the peer as host:port, for messages."""
    host, port = connection.getpeername()[:2]
    return f"{host}:{port}"
