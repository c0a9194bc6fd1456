"""One connection over a socket pair of the loopback."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from catoptra_server.serve.tcp_server import READ_BYTES, HttpRequestError, TcpConnection
from helpers.loopback import HOST, run_scenario, wait_until


@asynccontextmanager
async def connected(
    lost: list[TcpConnection],
) -> AsyncIterator[tuple[TcpConnection, socket.socket]]:
    """A connection, and the peer's end."""
    loop = asyncio.get_running_loop()
    with socket.create_server((HOST, 0)) as listener:
        peer = socket.create_connection(listener.getsockname())
        accepted, _ = listener.accept()
    accepted.setblocking(False)
    peer.setblocking(False)
    connection = TcpConnection("peer", on_lost=lost.append)
    await loop.connect_accepted_socket(lambda: connection, accepted)
    try:
        yield connection, peer
    finally:
        connection.abort()
        peer.close()
        await wait_until(lambda: bool(lost), "end of the connection")


def test_reads_are_bounded_and_complete() -> None:
    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            data = bytes(range(256)) * 200
            sending = asyncio.create_task(asyncio.get_running_loop().sock_sendall(peer, data))
            received = b""
            while len(received) < len(data):
                chunk = await connection.read()
                assert 0 < len(chunk) <= READ_BYTES
                received += chunk
            assert received == data
            await sending
            peer.shutdown(socket.SHUT_WR)
            assert await connection.read() == b""
            assert await connection.read() == b""

    run_scenario(scenario())


def test_input_that_waits_is_known_before_it_is_read() -> None:
    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            assert not connection.has_more_input
            await asyncio.get_running_loop().sock_sendall(peer, bytes(2 * READ_BYTES))
            assert connection.has_more_input  # in the kernel
            await connection.read()
            assert connection.has_more_input
            await connection.read()
            assert not connection.has_more_input

    run_scenario(scenario())


def test_dialogue_never_pauses_the_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            transport = connection._transport
            assert transport is not None

            def pause() -> None:
                raise AssertionError("paused: two calls of the system a request")

            monkeypatch.setattr(transport, "pause_reading", pause)
            for number in range(5):
                await asyncio.get_running_loop().sock_sendall(peer, bytes([number]))
                assert await connection.read() == bytes([number])

    run_scenario(scenario())


def test_peer_that_is_not_read_is_held_back() -> None:
    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            loop = asyncio.get_running_loop()
            sending = asyncio.create_task(loop.sock_sendall(peer, bytes(50_000_000)))
            await connection.read()
            # No turn of the loop reads more than two chunks ahead: the kernels' buffers fill.
            for _ in range(1000):
                await asyncio.sleep(0)
            assert not sending.done()
            sending.cancel()

    run_scenario(scenario())


@pytest.mark.parametrize("is_ahead", [False, True])
def test_end_of_a_peer_is_noticed_with_or_without_unread_input(is_ahead: bool) -> None:
    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            if is_ahead:
                await asyncio.get_running_loop().sock_sendall(peer, bytes(3 * READ_BYTES))
            peer.shutdown(socket.SHUT_WR)

            def is_noticed() -> bool:
                connection.check_peer()
                return connection.peer_ended_at_s is not None

            await wait_until(is_noticed, "end of the peer")
            assert len(await connection.read()) == (READ_BYTES if is_ahead else 0)

    run_scenario(scenario())


def test_reset_of_a_peer_is_noticed_although_input_is_unread() -> None:
    async def scenario() -> None:
        lost: list[TcpConnection] = []
        async with connected(lost) as (connection, peer):
            await asyncio.get_running_loop().sock_sendall(peer, bytes(3 * READ_BYTES))
            await connection.read()
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, bytes((1, 0, 0, 0, 0, 0, 0, 0)))
            peer.close()

            def is_lost() -> bool:
                connection.check_peer()
                return bool(lost)

            await wait_until(is_lost, "loss of the connection")
            assert connection.is_closing
            connection.write(b"to nobody")
            await connection.drain()

    run_scenario(scenario())


def test_drain_waits_for_a_peer_that_does_not_read() -> None:
    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            connection.write(bytes(50_000_000))
            draining = asyncio.create_task(connection.drain())
            await asyncio.sleep(0)
            assert not draining.done()
            assert connection.num_unsent_bytes > 1_000_000
            while not draining.done():
                await asyncio.get_running_loop().sock_recv(peer, 10_000_000)

    run_scenario(scenario())


def test_methods_before_the_socket_is_connected_do_nothing() -> None:
    async def scenario() -> None:
        connection = TcpConnection("peer", on_lost=lambda _: None)
        assert connection.is_closing
        assert not connection.is_connected
        connection.write(b"x")
        connection.close()
        connection.abort()
        assert connection.num_unsent_bytes == 0

    run_scenario(scenario())


@pytest.mark.parametrize("size", [1, 7, READ_BYTES])
@pytest.mark.parametrize(
    "line",
    [
        b"POST / HTTP/1.1\r\n",
        b"GET /x HTTP/1.0\n",
        b"OPTIONS * HTTP/1.1\r\n",
        b"GET /" + 5000 * b"x" + b" HTTP/1.1\r\n",
    ],
    ids=["POST", "GET", "OPTIONS", "long path"],
)
def test_first_line_when_an_http_request_is_an_error_in_any_segmentation(
    line: bytes, size: int
) -> None:
    async def read_all(connection: TcpConnection, peer: socket.socket) -> None:
        for begin in range(0, len(line), size):
            await asyncio.get_running_loop().sock_sendall(peer, line[begin : begin + size])
            await connection.read()

    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            with pytest.raises(HttpRequestError):
                await read_all(connection, peer)

    run_scenario(scenario())


@pytest.mark.parametrize(
    "data",
    [
        b"INIT {ClassName HTTP/1.1}\r\n",
        b"GETCONF {Type Robot}\r\nPOST / HTTP/1.1\r\n",
        b"GET /x HTTP/1.1 INIT\r\n",
        b"OKOKOK",
        bytes(100) + b"\n",
    ],
    ids=["value", "second line", "more behind", "requests for images", "zeros"],
)
def test_first_line_when_no_http_request_is_read(data: bytes) -> None:
    async def scenario() -> None:
        async with connected([]) as (connection, peer):
            await asyncio.get_running_loop().sock_sendall(peer, data)
            assert await connection.read() == data

    run_scenario(scenario())
