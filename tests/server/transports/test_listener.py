"""Listening sockets, and accepting without free descriptors."""

from __future__ import annotations

import asyncio
import logging
import resource
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from catoptra_server.serve import limits as listener
from catoptra_server.serve.limits import AcceptLoop, create_listener
from helpers.loopback import HOST, run_scenario, wait_until


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


def test_connections_are_handed_over_with_their_address() -> None:
    async def scenario() -> None:
        accepted: list[tuple[socket.socket, str]] = []
        end = create_listener(HOST, 0, name="x")
        loop = AcceptLoop(end, lambda *args: accepted.append(args), name="x")
        clients = [socket.create_connection((HOST, loop.port)) for _ in range(40)]
        await wait_until(lambda: len(accepted) == len(clients), "connection")
        addresses = {"{}:{}".format(*client.getsockname()) for client in clients}
        assert {address for _, address in accepted} == addresses
        loop.close()
        loop.close()
        for one in (*clients, *(end for end, _ in accepted)):
            one.close()

    run_scenario(scenario())


def test_connections_have_keepalive_and_send_without_delay() -> None:
    async def scenario() -> None:
        accepted: list[socket.socket] = []
        loop = AcceptLoop(
            create_listener(HOST, 0, name="x"), lambda end, _: accepted.append(end), name="x"
        )
        with socket.create_connection((HOST, loop.port)):
            await wait_until(lambda: bool(accepted), "connection")
            (end,) = accepted
            assert end.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
            assert end.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert end.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == 30
            end.close()
        loop.close()

    run_scenario(scenario())


def test_flood_of_connections_leaves_the_loop_to_others() -> None:
    async def scenario() -> None:
        accepted: list[socket.socket] = []
        loop = AcceptLoop(
            create_listener(HOST, 0, name="x"), lambda end, _: accepted.append(end), name="x"
        )
        clients = [socket.create_connection((HOST, loop.port)) for _ in range(100)]
        begin_s = time.monotonic()
        await wait_until(lambda: len(accepted) == len(clients), "last connection")
        # 1 ms for each but those of the last turn.
        assert time.monotonic() - begin_s > 0.05
        loop.close()
        for end in (*clients, *accepted):
            end.close()

    run_scenario(scenario())


def test_connection_that_is_refused_is_closed_and_logged(caplog: pytest.LogCaptureFixture) -> None:
    def refuse(accepted: socket.socket, address: str) -> None:
        raise ConnectionRefusedError("no room")

    async def scenario() -> None:
        loop = AcceptLoop(create_listener(HOST, 0, name="x"), refuse, name="x")
        reader, writer = await asyncio.open_connection(HOST, loop.port)
        assert await reader.read() == b""
        writer.close()
        loop.close()

    run_scenario(scenario())
    assert "to the x port closed: no room" in caplog.text


def test_accept_without_descriptors_pauses_with_a_line_and_continues(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> None:
        accepted: list[socket.socket] = []
        loop = AcceptLoop(
            create_listener(HOST, 0, name="image"),
            lambda end, _: accepted.append(end),
            name="image",
        )
        clients = [socket.socket() for _ in range(8)]
        with few_descriptors(2):
            for client in clients:
                client.connect((HOST, loop.port))
            await wait_until(lambda: len(caplog.records) == 3, "third pause")
            assert len(accepted) <= 2
        await wait_until(lambda: len(accepted) == len(clients), "other connections")
        for end in (*clients, *accepted):
            end.close()
        loop.close()

    monkeypatch.setattr(listener, "_ACCEPT_RETRY_S", 0.05)
    with caplog.at_level(logging.WARNING):
        run_scenario(scenario())
    assert "the image port accepts no connection for 0.05 s (3 times so far): Too many open" in (
        caplog.text
    )
    # One line a pause, whatever the number of connections in the backlog.
    assert len(caplog.records) <= 4
