"""Acceptance of connections, and who makes room for a newcomer."""

from __future__ import annotations

import asyncio
import logging
import re
import resource
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from catoptra_server.serve import port as port_module
from catoptra_server.serve.port import ConnectionLimits, Port, create_listener, warn_of_exposure
from helpers.loopback import HOST, wait_until


@pytest.mark.parametrize("host", ["127.0.0.1", "127.5.6.7", "::1", "localhost"])
async def test_loopback_is_no_exposure(host: str, caplog: pytest.LogCaptureFixture) -> None:
    await warn_of_exposure(host)
    assert caplog.records == []


@pytest.mark.parametrize(
    ("host", "named"),
    [("0.0.0.0", "0.0.0.0"), ("::", "::"), ("", "0.0.0.0"), ("192.0.2.7", "192.0.2.7")],
)
async def test_address_of_the_network_is_warned_of_in_words(
    host: str, named: str, caplog: pytest.LogCaptureFixture
) -> None:
    await warn_of_exposure(host)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "without authentication" in caplog.text
    assert named in caplog.text


async def test_unknown_host_is_left_to_the_ports(caplog: pytest.LogCaptureFixture) -> None:
    # A name that is wrong before any name server is queried.
    await warn_of_exposure("a..b")
    assert caplog.records == []


@contextmanager
def few_descriptors(num_free: int) -> Iterator[None]:
    """Let the process open only some more descriptors for the length of a block."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    probes = [socket.socket() for _ in range(num_free)]
    highest = max(probe.fileno() for probe in probes)
    for probe in probes:
        probe.close()
    resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 1, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


@pytest.mark.parametrize("host", ["", "localhost", HOST, "0.0.0.0"])
def test_listener_on_any_form_of_a_host_accepts_ipv4(host: str) -> None:
    with (
        create_listener(host, 0, name="x") as end,
        socket.create_connection((HOST, end.getsockname()[1])),
    ):
        pass


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="no IPv6 on this machine")
@pytest.mark.parametrize("peer", ["127.0.0.1", "::1"])
def test_listener_on_all_ipv6_addresses_accepts_both_families(peer: str) -> None:
    with create_listener("::", 0, name="x") as end:
        try:
            socket.create_connection((peer, end.getsockname()[1])).close()
        except OSError as error:
            pytest.skip(f"no address {peer} on this machine: {error}")


@pytest.mark.parametrize("host", ["256.1.1.1", "no.such.host.invalid", "192.0.2.1"])
def test_listener_on_an_address_of_another_machine_is_an_os_error_that_names_it(host: str) -> None:
    with pytest.raises(OSError, match=rf"control port {host}:0: "):
        create_listener(host, 0, name="control")


@dataclass(eq=False)
class FakeConnection:
    """A connection in any state."""

    accepted: socket.socket
    address: str
    opened_at_s: float
    has_handshake: bool = False
    has_left: bool = False
    is_in_use: bool = False

    def end(self) -> None:
        self.accepted.close()


@contextmanager
def open_port(
    limits: ConnectionLimits | None = None,
    *,
    refusal: str = "",
    check: Callable[[FakeConnection, float], str] = lambda connection, now_s: "",
) -> Iterator[Port[FakeConnection]]:
    """A port that opens, or refuses, every connection."""

    def open_connection(accepted: socket.socket, address: str) -> FakeConnection:
        if refusal:
            raise ConnectionRefusedError(refusal)
        return FakeConnection(accepted, address, asyncio.get_running_loop().time())

    listener = create_listener(HOST, 0, name="x")
    port = Port(
        listener,
        open_connection,
        name="x",
        limits=limits or ConnectionLimits(),
        first_bytes=re.compile(b"[A-Z]"),
        check=check,
    )
    try:
        yield port
    finally:
        port.close()
        port.close()
        for connection in port:
            connection.end()


async def test_connections_are_opened_with_their_address() -> None:
    with open_port() as port:
        clients = [socket.create_connection((HOST, port.number)) for _ in range(40)]
        await wait_until(lambda: len(port) == len(clients), "connection")
        addresses = {"{}:{}".format(*client.getsockname()) for client in clients}
        assert {one.address for one in port} == addresses
        for client in clients:
            client.close()


async def test_connections_have_keepalive_and_send_without_delay() -> None:
    with open_port() as port, socket.create_connection((HOST, port.number)):
        await wait_until(lambda: bool(len(port)), "connection")
        (end,) = (one.accepted for one in port)
        assert end.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        assert end.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert end.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == 30


async def test_newcomer_with_bytes_passes_a_storm_of_silent_and_closed_connections() -> None:
    with open_port(ConnectionLimits(max_connections=300)) as port:
        silent = [socket.create_connection((HOST, port.number)) for _ in range(100)]
        for client in silent[70:]:
            client.close()
        with socket.create_connection((HOST, port.number)) as newcomer:
            newcomer.sendall(b"INIT")
            address = "{}:{}".format(*newcomer.getsockname())
            await wait_until(lambda: any(one.address == address for one in port), "newcomer")
            # 64 at once, then 20 a second: five of the silent ones are still to come.
            assert len(port) < 68
        await wait_until(lambda: len(port) == 71, "connections that are still open")
        for client in silent:
            client.close()


async def test_newcomer_passes_a_storm_of_garbage_and_of_peers_that_end_their_direction() -> None:
    limits = ConnectionLimits(max_connections=300)
    with open_port(limits) as port:
        storm = []
        for number in range(120):
            client = socket.create_connection((HOST, port.number))
            client.sendall(b"OK" if number % 2 else b"\xff\0O")
            if number % 2:
                client.shutdown(socket.SHUT_WR)
            storm.append(client)
        with socket.create_connection((HOST, port.number)) as newcomer:
            newcomer.sendall(b"INIT")
            address = "{}:{}".format(*newcomer.getsockname())
            await wait_until(lambda: any(one.address == address for one in port), "newcomer")
            # 64 at once, then 20 a second: most of the others are still to come.
            assert len(port) < 90
        for client in storm:
            client.close()


def fill(port: Port[FakeConnection], **states: list[int]) -> list[FakeConnection]:
    """Give the connections of a port their states; `old` ones are 11 s of age."""
    connections = [*port]
    for state, numbers in states.items():
        for number in numbers:
            if state == "old":
                connections[number].opened_at_s -= 11.0
            else:
                setattr(connections[number], state, True)
    return connections


ALL = [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("states", "ended"),
    [
        ({}, 0),
        ({"has_handshake": [0, 1]}, 2),
        ({"has_handshake": ALL}, None),
        ({"is_in_use": ALL, "old": ALL}, None),
        ({"is_in_use": ALL, "has_left": [3]}, 3),
        # A newcomer whose first bytes have not been read yet stays.
        ({"has_left": [2, 3], "has_handshake": [0, 2, 3]}, 2),
        ({"is_in_use": [0, 1, 3], "old": ALL, "has_handshake": ALL}, 2),
        # Three quarters for those without a robot; the rest for newcomers.
        ({"old": ALL, "has_handshake": [0]}, 1),
        ({"old": [0, 1, 2], "has_handshake": [0, 1, 2]}, 3),
        ({"old": [0, 1, 2], "has_handshake": ALL}, 0),
    ],
)
async def test_newcomer_at_the_limit_takes_the_place_that_is_needed_least(
    states: dict[str, list[int]], ended: int | None
) -> None:
    with open_port(ConnectionLimits(max_connections=4)) as port:
        clients = [socket.create_connection((HOST, port.number)) for _ in range(4)]
        await wait_until(lambda: len(port) == 4, "full port")
        before = fill(port, **states)
        reader, writer = await asyncio.open_connection(HOST, port.number)
        if ended is None:
            assert await reader.read() == b""
            assert [*port] == before
        else:
            await wait_until(lambda: [*port] != before, "newcomer")
            assert [one for one in before if one not in port] == [before[ended]]
            assert len(port) == 4
        writer.close()
        for client in clients:
            client.close()


async def test_address_of_another_machine_has_a_limit_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(port_module, "find_shared_address", lambda address: "192.0.2.7")
    with open_port(ConnectionLimits(max_per_address=2)) as port:
        clients = [socket.create_connection((HOST, port.number)) for _ in range(2)]
        await wait_until(lambda: len(port) == 2, "connections")
        fill(port, has_handshake=[0, 1], is_in_use=[0, 1])
        reader, writer = await asyncio.open_connection(HOST, port.number)
        assert await reader.read() == b""
        writer.close()
        for client in clients:
            client.close()


async def test_connection_without_a_word_in_time_or_with_a_reason_is_ended(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    limits = ConnectionLimits(handshake_timeout_s=0.3)
    with open_port(limits, check=lambda one, _: "too old" if one.has_left else "") as port:
        ends = [await asyncio.open_connection(HOST, port.number) for _ in range(3)]
        await wait_until(lambda: len(port) == 3, "connections")
        fill(port, has_handshake=[0, 1], has_left=[1])
        assert await ends[1][0].read() == b""
        assert await ends[2][0].read() == b""
        assert not ends[0][0].at_eof()
        for _, writer in ends:
            writer.close()
    assert "nothing valid within 0.3 s" in caplog.text
    assert "too old" in caplog.text


async def test_memory_is_released_once_after_connections_have_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    releases: list[int] = []
    monkeypatch.setattr(port_module, "_TRIM_DELAY_S", 0.1)
    monkeypatch.setattr(port_module, "release_freed_memory", lambda: releases.append(1))
    with open_port() as port:
        clients = [socket.create_connection((HOST, port.number)) for _ in range(3)]
        await wait_until(lambda: len(port) == 3, "connections")
        for connection, client in zip(port, clients, strict=True):
            port.remove(connection)
            connection.end()
            client.close()
        await wait_until(lambda: bool(releases), "release")
        assert len(releases) == 1


async def test_connection_that_is_refused_is_closed_and_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with open_port(refusal="no room") as port:
        reader, writer = await asyncio.open_connection(HOST, port.number)
        assert await reader.read() == b""
        writer.close()
    assert "to the x port closed: no room" in caplog.text


async def test_accept_without_descriptors_pauses_with_a_line_and_continues(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_module, "_ACCEPT_RETRY_S", 0.05)
    caplog.set_level(logging.WARNING)
    clients = [socket.socket() for _ in range(8)]
    with open_port() as port:
        with few_descriptors(2):
            for client in clients:
                client.connect((HOST, port.number))
            await wait_until(lambda: len(caplog.records) == 3, "third pause")
            assert len(port) <= 2
        await wait_until(lambda: len(port) == len(clients), "other connections")
        for client in clients:
            client.close()
    assert "the x port accepts no connection for 0.05 s (3 times so far): Too many open" in (
        caplog.text
    )
    # One line a pause, whatever the number of connections in the backlog.
    assert len(caplog.records) <= 4
