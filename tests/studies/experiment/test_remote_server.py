"""Addresses of servers that run elsewhere, and the wait for their greeting."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from catoptra_client.server_address import ServerAddress
from catoptra_protocol.errors import ConnectionLostError, DomainError
from catoptra_studies.experiment.experiment_runner import parse_server_address, wait_for_server
from client.scripted_server import ScriptedControlPeer, serve_script, wait_for_close


@pytest.fixture
def closed_address() -> Iterator[ServerAddress]:
    """An address that rejects connections: the port is bound but not listening."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield ServerAddress("127.0.0.1", held.getsockname()[1], 5003)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("sim=there", ServerAddress("there", 3000, 5003)),
        ("sim=127.0.0.1:3100", ServerAddress("127.0.0.1", 3100, 5003)),
        ("sim=there:3100:5100", ServerAddress("there", 3100, 5100)),
    ],
)
def test_address_when_valid_is_parsed(text: str, address: ServerAddress) -> None:
    assert parse_server_address(text) == ("sim", address)


@pytest.mark.parametrize("text", ["there", "sim=", "sim=there:", "sim=there:x", "=there"])
def test_address_when_invalid_is_rejected_with_an_example(text: str) -> None:
    with pytest.raises(DomainError, match="sim=localhost"):
        parse_server_address(text)


def test_server_when_it_greets_is_returned() -> None:
    def greet(connection: socket.socket) -> None:
        ScriptedControlPeer(connection)
        wait_for_close(connection)

    with serve_script(greet) as port:
        address = ServerAddress("127.0.0.1", port, 5003)
        assert wait_for_server(address, timeout_s=0.0) == address


def test_server_when_it_never_answers_times_out(closed_address: ServerAddress) -> None:
    now, pauses = [0.0], []

    def sleep(time_s: float) -> None:
        pauses.append(time_s)
        now[0] += time_s

    with pytest.raises(ConnectionLostError, match="no control server at 127"):
        wait_for_server(closed_address, timeout_s=1.0, clock=lambda: now[0], sleep=sleep)
    assert 1.0 <= sum(pauses) < 1.5
