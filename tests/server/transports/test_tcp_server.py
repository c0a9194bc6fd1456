"""Port and connections end together, whatever the peers do."""

from __future__ import annotations

import asyncio
import logging

import pytest

from catoptra_server.transports.tcp_server import peer_name, serve_tcp
from helpers.loopback import HOST, connect, connect_without_reading, listening_port, run_scenario


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(1000):
        writer.write(data)


def test_connection_when_its_peer_disconnects_ends_after_all_bytes_are_sent() -> None:
    async def scenario() -> None:
        async with serve_tcp(HOST, 0, echo) as server:
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
        async with serve_tcp(HOST, 0, echo) as server:
            reader, writer = await connect(server)
            writer.write(b"x")
            await reader.readexactly(1)
        assert await reader.read() == b""
        writer.close()

    run_scenario(scenario())
    assert caplog.text == ""


def test_block_when_left_ends_a_connection_that_reads_nothing() -> None:
    async def pour(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(bytes(50_000_000))
        started.set()

    async def scenario() -> None:
        async with serve_tcp(HOST, 0, pour) as server:
            end = await connect_without_reading(server)
            await started.wait()
        end.close()

    started = asyncio.Event()
    run_scenario(scenario())


def test_connection_when_broken_is_logged_without_a_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def broken(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        raise TimeoutError("no route any more")

    async def scenario() -> None:
        async with serve_tcp(HOST, 0, broken) as server:
            reader, writer = await connect(server)
            assert await reader.read() == b""
            writer.close()

    with caplog.at_level(logging.INFO):
        run_scenario(scenario())
    assert "disconnected: no route any more" in caplog.text
    assert "Traceback" not in caplog.text


def test_connection_when_another_one_fails_continues(caplog: pytest.LogCaptureFixture) -> None:
    async def fragile(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(1000):
            writer.write(bytes([100 // (data[0] - ord("0"))]))

    async def scenario() -> None:
        async with serve_tcp(HOST, 0, fragile) as server:
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
        async with serve_tcp(HOST, 0, echo) as server:
            with pytest.raises(OSError, match="in use"):
                async with serve_tcp(HOST, listening_port(server), echo):
                    pass

    run_scenario(scenario())


def test_peer_name_is_the_address() -> None:
    async def scenario() -> None:
        async with serve_tcp(HOST, 0, echo) as server:
            _, writer = await connect(server)
            assert peer_name(writer) == f"{HOST}:{listening_port(server)}"
            writer.close()

    run_scenario(scenario())


def test_connection_when_the_limit_is_reached_is_closed_and_later_accepted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scenario() -> None:
        async with serve_tcp(HOST, 0, echo, max_connections=1) as server:
            (_, first), (reader, second) = await connect(server), await connect(server)
            assert await reader.read() == b""
            first.close()
            data = b""
            while not data:  # the end of the first is detected soon
                reader, third = await connect(server)
                third.write(b"x")
                third.write_eof()
                data = await reader.read()
                third.close()
            second.close()

    run_scenario(scenario())
    assert "rejected: the limit of 1 connections is reached" in caplog.text
