"""Port and connections end together, whatever the peers do."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import re
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager

import pytest

from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.tcp_server import TcpConnection, TcpServer, serve_tcp
from helpers.loopback import HOST, abort, connect, connect_without_reading, wait_until

READ_BYTES = 4096


async def echo(connection: TcpConnection) -> None:
    while data := await connection.read():
        connection.has_handshake = True
        connection.has_robot = data == b"idle"
        connection.write(data)


def serve(
    handler: Callable[[TcpConnection], Awaitable[None]],
    *,
    end_grace_s: float = 5.0,
    port: int = 0,
    **limits: float,
) -> AbstractAsyncContextManager[TcpServer]:
    return serve_tcp(
        HOST,
        port,
        handler,
        name="echo",
        first_bytes=re.compile(b""),
        limits=ConnectionLimits(**limits),  # type: ignore[arg-type] # an int among them
        end_grace_s=end_grace_s,
    )


async def test_connection_when_its_peer_disconnects_ends_after_all_bytes_are_sent() -> None:
    async with serve(echo) as server:
        reader, writer = await connect(server)
        writer.write(b"hello")
        writer.write_eof()
        assert await reader.read() == b"hello"
        writer.close()


async def test_block_when_left_ends_idle_connections(caplog: pytest.LogCaptureFixture) -> None:
    async with serve(echo) as server:
        reader, writer = await connect(server)
        writer.write(b"x")
        await reader.readexactly(1)
    assert await reader.read() == b""
    writer.close()
    assert caplog.text == ""


async def test_block_when_left_ends_a_connection_that_reads_nothing() -> None:
    async def pour(connection: TcpConnection) -> None:
        connection.write(bytes(50_000_000))
        started.set()

    started = asyncio.Event()
    async with serve(pour) as server:
        end = await connect_without_reading(server)
        await started.wait()
    end.close()


async def test_connection_when_broken_is_logged_without_a_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def broken(connection: TcpConnection) -> None:
        raise TimeoutError("no route any more")

    caplog.set_level(logging.INFO)
    async with serve(broken) as server:
        reader, writer = await connect(server)
        assert await reader.read() == b""
        writer.close()
    assert "disconnected: no route any more" in caplog.text
    assert "Traceback" not in caplog.text


async def test_connection_when_another_one_fails_continues(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def fragile(connection: TcpConnection) -> None:
        while data := await connection.read():
            connection.write(bytes([100 // (data[0] - ord("0"))]))

    async with serve(fragile) as server:
        (good_in, good_out), (bad_in, bad_out) = await connect(server), await connect(server)
        bad_out.write(b"0")
        assert await bad_in.read() == b""
        good_out.write(b"5")
        assert await good_in.readexactly(1) == bytes([20])
        good_out.close()
        bad_out.close()
    assert "ZeroDivisionError" in caplog.text  # a bug is logged with its location


async def test_port_when_in_use_is_an_os_error() -> None:
    async with serve(echo) as server:
        with pytest.raises(OSError, match=r"echo port .* in use"):
            async with serve(echo, port=server.port):
                pass


async def test_connection_when_the_limit_is_reached_is_closed_and_later_accepted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with serve(echo, max_connections=1) as server:
        in_, first = await connect(server)
        first.write(b"x")
        await in_.readexactly(1)
        reader, second = await connect(server)
        assert await reader.read() == b""
        first.close()
        await wait_until(lambda: not server.num_connections, "end of the first")
        in_, third = await connect(server)
        third.write(b"x")
        assert await in_.readexactly(1) == b"x"
        third.close()
        second.close()
    assert "the limit of 1 connections is reached" in caplog.text


async def test_connection_without_a_handshake_makes_room_for_newcomers_the_oldest_first() -> None:
    async with serve(echo, max_connections=3) as server:
        (talking_in, talking), (old_in, old), (newer_in, newer) = [
            await connect(server) for _ in range(3)
        ]
        talking.write(b"x")
        await talking_in.readexactly(1)
        in_, out = await connect(server)
        out.write(b"y")
        assert await in_.readexactly(1) == b"y"
        assert await old_in.read() == b""
        # The others are open.
        for reader, writer in ((talking_in, talking), (newer_in, newer)):
            writer.write(b"z")
            assert await reader.readexactly(1) == b"z"
        assert server.num_connections == 3
        for writer in (talking, old, newer, out):
            writer.close()


async def test_connection_whose_peer_has_left_makes_room_for_newcomers() -> None:
    async def wait_for_ever(connection: TcpConnection) -> None:
        connection.write(await connection.read())
        connection.has_handshake = True
        await asyncio.Event().wait()

    async with serve(wait_for_ever, max_connections=2) as server:
        ends = [await connect(server) for _ in range(2)]
        for reader, writer in ends:
            writer.write(b"x")
            await reader.readexactly(1)
        (staying_in, staying), (leaving_in, leaving) = ends
        leaving.write_eof()
        connections = list(server._port)
        ended = connections[1]
        await wait_until(lambda: ended.peer_ended_at_s is not None, "end of a peer")
        in_, out = await connect(server)
        out.write(b"y")
        assert await in_.readexactly(1) == b"y"
        assert await leaving_in.read() == b""
        assert not staying_in.at_eof()
        for writer in (staying, leaving, out):
            writer.close()


async def test_connection_without_a_handshake_in_time_is_closed_whatever_it_sends() -> None:
    async def swallow(connection: TcpConnection) -> None:
        while await connection.read():
            pass

    async with serve(swallow, handshake_timeout_s=0.3) as server:
        reader, writer = await connect(server)
        while not reader.at_eof():
            with contextlib.suppress(ConnectionError):
                writer.write(b"garbage")
                await writer.drain()
            with contextlib.suppress(TimeoutError, ConnectionError):
                await asyncio.wait_for(reader.read(1), 0.02)
        writer.close()


async def test_connection_when_silent_is_closed_unless_it_has_a_robot() -> None:
    async with serve(echo, idle_timeout_s=0.05) as server:
        (silent_in, silent), (driver_in, driver) = await connect(server), await connect(server)
        silent.write(b"x")
        driver.write(b"idle")
        assert await driver_in.readexactly(4) == b"idle"
        assert await silent_in.read() == b"x"
        driver.write(b"y")
        assert await driver_in.readexactly(1) == b"y"
        silent.close()
        driver.close()


async def test_connection_when_its_peer_half_closes_has_a_limited_time_for_replies() -> None:
    async def wait_for_ever(connection: TcpConnection) -> None:
        connection.write(b"last words")
        await asyncio.Event().wait()

    async with serve(wait_for_ever, end_grace_s=0.05) as server:
        reader, writer = await connect(server)
        writer.write_eof()
        assert await reader.read() == b"last words"
        await wait_until(lambda: not server.num_connections, "end of the connection")
        writer.close()


async def test_handler_is_cancelled_when_its_connection_is_reset() -> None:
    async def wait_for_ever(connection: TcpConnection) -> None:
        started.set()
        try:
            await asyncio.Event().wait()
        finally:
            ended.set()

    started, ended = asyncio.Event(), asyncio.Event()
    async with serve(wait_for_ever) as server:
        _, writer = await connect(server)
        await started.wait()
        abort(writer)
        await ended.wait()
        await wait_until(lambda: not server.num_connections, "end of the connection")


async def test_connections_when_they_come_and_go_leave_no_descriptor() -> None:
    async with serve(echo) as server:
        before = count_descriptors()
        for _ in range(100):
            _, writer = await connect(server)
            abort(writer)
        await wait_until(lambda: not server.num_connections, "end of the connections")
        await wait_until(lambda: count_descriptors() <= before, "release of descriptors")


def count_descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


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


async def test_reads_are_bounded_and_complete() -> None:
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


async def test_input_that_waits_is_known_before_it_is_read() -> None:
    async with connected([]) as (connection, peer):
        assert not connection.has_more_input
        await asyncio.get_running_loop().sock_sendall(peer, bytes(2 * READ_BYTES))
        assert connection.has_more_input  # in the kernel
        await connection.read()
        assert connection.has_more_input
        await connection.read()
        assert not connection.has_more_input


async def test_dialogue_never_pauses_the_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    async with connected([]) as (connection, peer):
        transport = connection._transport
        assert transport is not None

        def pause() -> None:
            raise AssertionError("paused: two calls of the system a request")

        monkeypatch.setattr(transport, "pause_reading", pause)
        for number in range(5):
            await asyncio.get_running_loop().sock_sendall(peer, bytes([number]))
            assert await connection.read() == bytes([number])


async def test_peer_that_is_not_read_is_held_back() -> None:
    async with connected([]) as (connection, peer):
        loop = asyncio.get_running_loop()
        sending = asyncio.create_task(loop.sock_sendall(peer, bytes(50_000_000)))
        await connection.read()
        # No turn of the loop reads more than two chunks ahead: the kernels' buffers fill.
        for _ in range(1000):
            await asyncio.sleep(0)
        assert not sending.done()
        sending.cancel()


@pytest.mark.parametrize("is_ahead", [False, True])
async def test_end_of_a_peer_is_noticed_with_or_without_unread_input(is_ahead: bool) -> None:
    async with connected([]) as (connection, peer):
        if is_ahead:
            await asyncio.get_running_loop().sock_sendall(peer, bytes(3 * READ_BYTES))
        peer.shutdown(socket.SHUT_WR)

        def is_noticed() -> bool:
            connection.check_peer()
            return connection.peer_ended_at_s is not None

        await wait_until(is_noticed, "end of the peer")
        assert len(await connection.read()) == (READ_BYTES if is_ahead else 0)


async def test_reset_of_a_peer_is_noticed_although_input_is_unread() -> None:
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


async def test_drain_waits_for_a_peer_that_does_not_read() -> None:
    async with connected([]) as (connection, peer):
        connection.write(bytes(50_000_000))
        draining = asyncio.create_task(connection.drain())
        await asyncio.sleep(0)
        assert not draining.done()
        assert connection.num_unsent_bytes > 1_000_000
        while not draining.done():
            await asyncio.get_running_loop().sock_recv(peer, 10_000_000)


async def test_methods_before_the_socket_is_connected_do_nothing() -> None:
    connection = TcpConnection("peer", on_lost=lambda _: None)
    assert connection.is_closing
    assert not connection.is_connected
    connection.write(b"x")
    connection.close()
    connection.abort()
    assert connection.num_unsent_bytes == 0


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
async def test_first_line_when_an_http_request_is_an_error_in_any_segmentation(
    line: bytes, size: int
) -> None:
    async def read_all(connection: TcpConnection, peer: socket.socket) -> None:
        for begin in range(0, len(line), size):
            await asyncio.get_running_loop().sock_sendall(peer, line[begin : begin + size])
            await connection.read()

    async with connected([]) as (connection, peer):
        with pytest.raises(ConnectionError, match="an HTTP request"):
            await read_all(connection, peer)


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
async def test_first_line_when_no_http_request_is_read(data: bytes) -> None:
    async with connected([]) as (connection, peer):
        await asyncio.get_running_loop().sock_sendall(peer, data)
        assert await connection.read() == data
