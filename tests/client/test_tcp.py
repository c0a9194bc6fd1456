"""TCP connections: to a server, and to a port without one."""

from __future__ import annotations

import socket

import pytest

from catoptra_client.control_connection import open_connection, peer_address
from catoptra_protocol.errors import ConnectionLostError


def test_connection_when_open_sends_at_once_and_names_the_peer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with open_connection("127.0.0.1", port, 5.0, server_kind="image") as connection:
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert peer_address(connection) == f"127.0.0.1:{port}"


@pytest.mark.parametrize("kind", ["control", "image"])
def test_connection_when_nobody_listens_names_the_server_and_the_option(kind: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(ConnectionLostError, match=f"no {kind} server at .*--{kind}-port"):
        open_connection("127.0.0.1", port, 5.0, server_kind=kind)
