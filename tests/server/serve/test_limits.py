"""Limits of connections, of their time on the event loop, and of their acceptance."""

from __future__ import annotations

import asyncio
import logging
import resource
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from catoptra_server.serve import limits as limits_module
from catoptra_server.serve.limits import (
    AcceptLoop,
    LoopCalls,
    LoopShare,
    create_listener,
    fit_connections,
    warn_of_exposure,
)
from helpers.loopback import HOST, run_scenario, wait_until


@pytest.mark.parametrize(
    ("soft_limit", "share", "descriptors_each", "fitting"),
    [
        (1024, 0.25, 1, 64),
        (300, 0.25, 1, 50),
        (300, 0.5, 3, 33),
        (100, 0.25, 1, 1),
        (20, 0.25, 1, 1),
        (resource.RLIM_INFINITY, 0.25, 1, 64),
    ],
)
def test_limit_fits_into_the_share_of_the_descriptors(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    soft_limit: int,
    share: float,
    descriptors_each: int,
    fitting: int,
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (soft_limit, soft_limit))
    limit = fit_connections(64, share=share, descriptors_each=descriptors_each, name="image")
    assert limit == fitting
    assert (f"the image port has {fitting} connections" in caplog.text) is (fitting < 64)


class Clock:
    """Time that passes by assignment."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_single_command_waits_for_nothing() -> None:
    share = LoopShare(0.3)
    account = share.open_account()
    with account.charge_block():
        pass
    account.charge_read()
    assert share.remaining_wait_s(account) < 0.0


def test_flood_of_reads_or_of_work_waits() -> None:
    share = LoopShare(0.3)
    reading, working = share.open_account(), share.open_account()
    for _ in range(200):
        reading.charge_read()
    assert share.remaining_wait_s(reading) > 0.0
    with working.charge_block():
        end_s = time.thread_time() + 0.05
        while time.thread_time() < end_s:
            pass
    assert share.remaining_wait_s(working) > 0.0


@pytest.mark.parametrize("num_connections", [1, 2, 64])
def test_flood_of_any_number_of_connections_takes_the_share_of_the_time(
    num_connections: int,
) -> None:
    clock = Clock()
    share = LoopShare(0.3, monotonic=clock)
    accounts = [share.open_account() for _ in range(num_connections)]
    begin_s, used_s = clock.now_s, 0.0
    while clock.now_s < begin_s + 20.0:
        ready = [one for one in accounts if share.remaining_wait_s(one) <= 0.0]
        for account in ready:
            share.charge(account, 0.002)
            clock.now_s += 0.002
            used_s += 0.002
        clock.now_s += 0.0005
    # The bursts at the begin come on top.
    assert used_s / 20.0 == pytest.approx(0.3, rel=0.2)


def test_wait_after_an_expensive_chunk_is_limited() -> None:
    clock = Clock()
    share = LoopShare(0.3, monotonic=clock)
    account = share.open_account()
    share.charge(account, 60.0)
    assert share.remaining_wait_s(account) == pytest.approx(1.0)


def test_dialogue_waits_for_nothing_however_long_it_lasts() -> None:
    clock = Clock()
    share = LoopShare(0.3, monotonic=clock)
    account = share.open_account()
    for _ in range(1000):
        account.charge(0.001)
        account.write_off()
        account.charge_read()
        clock.now_s += 0.001
        assert share.remaining_wait_s(account) < 0.0


def test_connection_that_stopped_counts_no_more() -> None:
    clock = Clock()
    share = LoopShare(0.5, monotonic=clock)
    first, second = share.open_account(), share.open_account()
    share.charge(first, 0.01)
    clock.now_s += 10.0
    share.charge(second, 0.05)
    assert share.remaining_wait_s(second) == pytest.approx(0.05 / 0.5 - 0.02)


NUM_CALLS = 20_000


def test_calls_of_a_thread_arrive_in_order_and_none_is_lost() -> None:
    async def scenario() -> None:
        received, end = list[int](), asyncio.Event()
        calls = LoopCalls()

        def produce() -> None:
            for number in range(NUM_CALLS):
                calls.call(partial(received.append, number))
            calls.call(end.set)

        thread = threading.Thread(target=produce)
        thread.start()
        await end.wait()
        thread.join()
        assert received == list(range(NUM_CALLS))

    run_scenario(scenario())


def test_calls_before_the_loop_runs_wake_it_once() -> None:
    async def scenario() -> None:
        loop, wake_ups, received = asyncio.get_running_loop(), list[object](), list[int]()
        calls = LoopCalls()
        wake, loop.call_soon_threadsafe = loop.call_soon_threadsafe, wake_ups.append  # type: ignore[method-assign,assignment] # counted
        for number in range(100):
            calls.call(partial(received.append, number))
        loop.call_soon_threadsafe = wake  # type: ignore[method-assign]
        assert len(wake_ups) == 1
        loop.call_soon(wake_ups[0])  # type: ignore[arg-type]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert received == list(range(100))

    run_scenario(scenario())


def test_call_that_raises_does_not_end_the_others() -> None:
    async def scenario() -> None:
        loop, errors, received = asyncio.get_running_loop(), list[object](), list[int]()
        loop.set_exception_handler(lambda _, context: errors.append(context["exception"]))
        calls = LoopCalls()
        for function in (
            partial(received.append, 1),
            partial(divmod, 1, 0),
            partial(received.append, 2),
        ):
            calls.call(function)
        while len(received) < 2:
            await asyncio.sleep(0)
        assert received == [1, 2]
        assert [type(error) for error in errors] == [ZeroDivisionError]

    run_scenario(scenario())


@pytest.mark.parametrize("host", ["127.0.0.1", "127.5.6.7", "::1", "localhost"])
def test_loopback_is_no_exposure(host: str, caplog: pytest.LogCaptureFixture) -> None:
    run_scenario(warn_of_exposure(host))
    assert caplog.records == []


@pytest.mark.parametrize(
    ("host", "named"),
    [("0.0.0.0", "0.0.0.0"), ("::", "::"), ("", "0.0.0.0"), ("192.0.2.7", "192.0.2.7")],
)
def test_address_of_the_network_is_warned_of_in_words(
    host: str, named: str, caplog: pytest.LogCaptureFixture
) -> None:
    run_scenario(warn_of_exposure(host))
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "without authentication" in caplog.text
    assert named in caplog.text


def test_unknown_host_is_left_to_the_ports(caplog: pytest.LogCaptureFixture) -> None:
    # A name that is wrong before any name server is queried.
    run_scenario(warn_of_exposure("a..b"))
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

    monkeypatch.setattr(limits_module, "_ACCEPT_RETRY_S", 0.05)
    with caplog.at_level(logging.WARNING):
        run_scenario(scenario())
    assert "the image port accepts no connection for 0.05 s (3 times so far): Too many open" in (
        caplog.text
    )
    # One line a pause, whatever the number of connections in the backlog.
    assert len(caplog.records) <= 4
