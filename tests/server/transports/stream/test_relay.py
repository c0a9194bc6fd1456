"""One direction of a connection: order, backpressure, pauses and ends."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.serve.stream.guard import InspectBytes, Relay
from helpers.loopback import run_scenario, wait_until


class RelayFixture:
    """A relay between two pairs of sockets; the test holds `near` and `far`."""

    def __init__(self, inspect: InspectBytes) -> None:
        self.near, source = socket.socketpair()
        sink, self.far = socket.socketpair()
        self.sockets = (self.near, source, sink, self.far)
        for end in self.sockets:
            end.setblocking(False)
        self.ends: list[Exception | None] = []
        self.relay = Relay(source, sink, read_bytes=1000, inspect=inspect, on_end=self.ends.append)


@contextmanager
def open_relay(inspect: InspectBytes = lambda data: (data, 0.0)) -> Iterator[RelayFixture]:
    fixture = RelayFixture(inspect)
    try:
        yield fixture
    finally:
        fixture.relay.close()
        for end in fixture.sockets:
            end.close()


def test_bytes_pass_in_order_whatever_the_sink_accepts() -> None:
    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        with open_relay() as fixture:
            data = bytes(range(256)) * 4000
            sending = asyncio.create_task(loop.sock_sendall(fixture.near, data))
            await wait_until(lambda: fixture.relay.is_blocked, "full sink")
            received = bytearray()
            while len(received) < len(data):
                received += await loop.sock_recv(fixture.far, 65536)
            await sending
            assert received == data
            assert not fixture.relay.is_blocked

    run_scenario(scenario())


def test_source_when_paused_is_read_after_the_pause() -> None:
    pauses = [0.05, 0.0]

    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        with open_relay(lambda data: (data, pauses.pop(0))) as fixture:
            fixture.near.send(bytes(2000))
            begin_s = loop.time()
            assert len(await loop.sock_recv(fixture.far, 10_000)) == 1000
            assert len(await loop.sock_recv(fixture.far, 10_000)) == 1000
            assert loop.time() - begin_s > 0.04
            assert pauses == []

    run_scenario(scenario())


def test_end_of_the_source_is_reported_after_its_bytes() -> None:
    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        with open_relay() as fixture:
            fixture.near.send(b"last")
            fixture.near.close()
            assert await loop.sock_recv(fixture.far, 100) == b"last"
            await wait_until(lambda: bool(fixture.ends), "end")
            assert fixture.ends[0] is None

    run_scenario(scenario())


def test_end_of_the_sink_is_reported() -> None:
    async def scenario() -> None:
        with open_relay() as fixture:
            fixture.far.close()
            fixture.near.send(b"data")
            await wait_until(lambda: bool(fixture.ends), "end")
            assert isinstance(fixture.ends[0], BrokenPipeError)

    run_scenario(scenario())


def test_bytes_when_rejected_are_not_relayed() -> None:
    def reject(data: bytes) -> tuple[bytes, float]:
        raise RemoteProtocolError("bad")

    async def scenario() -> None:
        with open_relay(reject) as fixture:
            fixture.near.send(b"data")
            await wait_until(lambda: bool(fixture.ends), "end")
            assert isinstance(fixture.ends[0], RemoteProtocolError)
            with pytest.raises(BlockingIOError):
                fixture.far.recv(1)

    run_scenario(scenario())


def test_relay_when_closed_in_a_pause_reads_nothing_more() -> None:
    async def scenario() -> None:
        with open_relay(lambda data: (data, 0.001)) as fixture:
            fixture.near.send(bytes(100))
            await asyncio.get_running_loop().sock_recv(fixture.far, 100)
            fixture.relay.close()
            fixture.near.send(bytes(100))
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(asyncio.get_running_loop().sock_recv(fixture.far, 100), 0.05)

    run_scenario(scenario())
