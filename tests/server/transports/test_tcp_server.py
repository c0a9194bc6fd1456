"""Port and connections end together, whatever the peers do."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from contextlib import AbstractAsyncContextManager

import pytest

from catoptra_server.serve.tcp_server import (
    ConnectionHandler,
    ConnectionLimits,
    TcpConnection,
    TcpServer,
    serve_tcp,
)
from helpers.loopback import (
    HOST,
    abort,
    connect,
    connect_without_reading,
    run_scenario,
    wait_until,
)


async def echo(connection: TcpConnection) -> None:
    while data := await connection.read():
        connection.has_handshake = True
        connection.may_idle = data == b"idle"
        connection.write(data)


def serve(
    handler: ConnectionHandler, *, end_grace_s: float = 5.0, port: int = 0, **limits: float
) -> AbstractAsyncContextManager[TcpServer]:
    return serve_tcp(
        HOST,
        port,
        handler,
        name="echo",
        limits=ConnectionLimits(**limits),  # type: ignore[arg-type] # an int among them
        end_grace_s=end_grace_s,
    )


def test_connection_when_its_peer_disconnects_ends_after_all_bytes_are_sent() -> None:
    async def scenario() -> None:
        async with serve(echo) as server:
            reader, writer = await connect(server)
            writer.write(b"hello")
            writer.write_eof()
            assert await reader.read() == b"hello"
            writer.close()

    run_scenario(scenario())


def test_block_when_left_ends_idle_connections(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scenario() -> None:
        async with serve(echo) as server:
            reader, writer = await connect(server)
            writer.write(b"x")
            await reader.readexactly(1)
        assert await reader.read() == b""
        writer.close()

    run_scenario(scenario())
    assert caplog.text == ""


def test_block_when_left_ends_a_connection_that_reads_nothing() -> None:
    async def pour(connection: TcpConnection) -> None:
        connection.write(bytes(50_000_000))
        started.set()

    async def scenario() -> None:
        async with serve(pour) as server:
            end = await connect_without_reading(server)
            await started.wait()
        end.close()

    started = asyncio.Event()
    run_scenario(scenario())


def test_connection_when_broken_is_logged_without_a_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def broken(connection: TcpConnection) -> None:
        raise TimeoutError("no route any more")

    async def scenario() -> None:
        async with serve(broken) as server:
            reader, writer = await connect(server)
            assert await reader.read() == b""
            writer.close()

    with caplog.at_level(logging.INFO):
        run_scenario(scenario())
    assert "disconnected: no route any more" in caplog.text
    assert "Traceback" not in caplog.text


def test_connection_when_another_one_fails_continues(caplog: pytest.LogCaptureFixture) -> None:
    async def fragile(connection: TcpConnection) -> None:
        while data := await connection.read():
            connection.write(bytes([100 // (data[0] - ord("0"))]))

    async def scenario() -> None:
        async with serve(fragile) as server:
            (good_in, good_out), (bad_in, bad_out) = await connect(server), await connect(server)
            bad_out.write(b"0")
            assert await bad_in.read() == b""
            good_out.write(b"5")
            assert await good_in.readexactly(1) == bytes([20])
            good_out.close()
            bad_out.close()

    run_scenario(scenario())
    assert "ZeroDivisionError" in caplog.text  # a bug is logged with its location


def test_port_when_in_use_is_an_os_error() -> None:
    async def scenario() -> None:
        async with serve(echo) as server:
            with pytest.raises(OSError, match=r"echo port .* in use"):
                async with serve(echo, port=server.port):
                    pass

    run_scenario(scenario())


def test_connection_when_the_limit_is_reached_is_closed_and_later_accepted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scenario() -> None:
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

    run_scenario(scenario())
    assert "the limit of 1 connections is reached" in caplog.text


def test_connection_without_a_handshake_makes_room_for_newcomers_the_oldest_first() -> None:
    async def scenario() -> None:
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

    run_scenario(scenario())


def test_connection_whose_peer_has_left_makes_room_for_newcomers() -> None:
    async def wait_for_ever(connection: TcpConnection) -> None:
        connection.write(await connection.read())
        connection.has_handshake = True
        await asyncio.Event().wait()

    async def scenario() -> None:
        async with serve(wait_for_ever, max_connections=2) as server:
            ends = [await connect(server) for _ in range(2)]
            for reader, writer in ends:
                writer.write(b"x")
                await reader.readexactly(1)
            (staying_in, staying), (leaving_in, leaving) = ends
            leaving.write_eof()
            connections = list(server._connections)
            ended = connections[1]
            await wait_until(lambda: ended.peer_ended_at_s is not None, "end of a peer")
            in_, out = await connect(server)
            out.write(b"y")
            assert await in_.readexactly(1) == b"y"
            assert await leaving_in.read() == b""
            assert not staying_in.at_eof()
            for writer in (staying, leaving, out):
                writer.close()

    run_scenario(scenario())


def test_connection_without_a_handshake_in_time_is_closed_whatever_it_sends() -> None:
    async def swallow(connection: TcpConnection) -> None:
        while await connection.read():
            pass

    async def scenario() -> None:
        async with serve(swallow, handshake_timeout_s=0.3) as server:
            reader, writer = await connect(server)
            while not reader.at_eof():
                with contextlib.suppress(ConnectionError):
                    writer.write(b"garbage")
                    await writer.drain()
                with contextlib.suppress(TimeoutError, ConnectionError):
                    await asyncio.wait_for(reader.read(1), 0.02)
            writer.close()

    run_scenario(scenario())


def test_connection_when_silent_is_closed_unless_it_may_idle() -> None:
    async def scenario() -> None:
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

    run_scenario(scenario())


def test_connection_when_its_peer_half_closes_has_a_limited_time_for_replies() -> None:
    async def wait_for_ever(connection: TcpConnection) -> None:
        connection.write(b"last words")
        await asyncio.Event().wait()

    async def scenario() -> None:
        async with serve(wait_for_ever, end_grace_s=0.05) as server:
            reader, writer = await connect(server)
            writer.write_eof()
            assert await reader.read() == b"last words"
            await wait_until(lambda: not server.num_connections, "end of the connection")
            writer.close()

    run_scenario(scenario())


def test_handler_is_cancelled_when_its_connection_is_reset() -> None:
    async def wait_for_ever(connection: TcpConnection) -> None:
        started.set()
        try:
            await asyncio.Event().wait()
        finally:
            ended.set()

    async def scenario() -> None:
        async with serve(wait_for_ever) as server:
            _, writer = await connect(server)
            await started.wait()
            abort(writer)
            await ended.wait()
            await wait_until(lambda: not server.num_connections, "end of the connection")

    started, ended = asyncio.Event(), asyncio.Event()
    run_scenario(scenario())


def test_connections_when_they_come_and_go_leave_no_descriptor() -> None:
    async def scenario() -> None:
        async with serve(echo) as server:
            before = count_descriptors()
            for _ in range(100):
                _, writer = await connect(server)
                abort(writer)
            await wait_until(lambda: not server.num_connections, "end of the connections")
            await wait_until(lambda: count_descriptors() <= before, "release of descriptors")

    run_scenario(scenario())


def count_descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))
