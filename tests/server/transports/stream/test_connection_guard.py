"""The connection guard: unchanged bytes, rejected connections, and complete clean-up."""

from __future__ import annotations

import asyncio
import select
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from catoptra_server.serve.limits import create_listener
from catoptra_server.serve.stream import guard as connection_guard
from catoptra_server.serve.stream.guard import ConnectionGuard
from catoptra_server.serve.tcp_server import ConnectionLimits
from helpers.loopback import HOST, SMALL_BUFFER_BYTES, Streams, run_scenario, wait_until
from helpers.zmtp import GREETING, LONG, MORE, READY, zmtp_frame

HELLO = GREETING + READY
REQUEST = zmtp_frame(b"request")


@dataclass
class GuardedPort:
    """An open guard: its port, and its connections to the inside."""

    port: int
    accepted: asyncio.Queue[Streams]


@asynccontextmanager
async def open_guard(
    folder: Path, limits: ConnectionLimits | None = None
) -> AsyncIterator[GuardedPort]:
    accepted: asyncio.Queue[Streams] = asyncio.Queue()
    path = str(folder / "inside")
    server = await asyncio.start_unix_server(lambda *ends: accepted.put_nowait(ends), path)
    bound = create_listener(HOST, 0, name="stream")
    guard = ConnectionGuard(bound, path, limits=limits or ConnectionLimits())
    try:
        yield GuardedPort(bound.getsockname()[1], accepted)
    finally:
        guard.close()
        server.close()


@contextmanager
def connect_client(port: int) -> Iterator[socket.socket]:
    """Connect without blocking the loop."""
    with socket.create_connection((HOST, port)) as end:
        end.setblocking(False)
        yield end


async def write_until_blocked(writer: asyncio.StreamWriter) -> int:
    """Write blocks of 1 MB until one stays in this process; their number, at most 100."""
    writer.transport.set_write_buffer_limits(0)
    written = 0
    # The kernel buffers a few megabytes.
    while written < 100 and writer.transport.get_write_buffer_size() == 0:
        writer.write(bytes(1_000_000))
        written += 1
        for _ in range(100):
            await asyncio.sleep(0)
    return written


async def relay(folder: Path, sent: bytes) -> bytes:
    """Bytes that reach the inside before the connection ends."""
    async with open_guard(folder) as guard:
        with connect_client(guard.port) as end:
            reader, writer = await guard.accepted.get()
            await asyncio.get_running_loop().sock_sendall(end, sent)
            received = await reader.read()
            writer.close()
            return received


def test_bytes_when_larger_than_every_buffer_pass_both_ways_unchanged(tmp_path: Path) -> None:
    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        up = HELLO + 100 * zmtp_frame(bytes(8 * 1024), LONG)
        down = bytes(range(256)) * 16_000
        async with open_guard(tmp_path) as guard:
            with connect_client(guard.port) as end:
                reader, writer = await guard.accepted.get()
                sending = asyncio.create_task(loop.sock_sendall(end, up))
                writer.write(down)
                assert await reader.readexactly(len(up)) == up
                received = bytearray()
                while len(received) < len(down):
                    received += await loop.sock_recv(end, 100_000)
                await sending
                writer.close()
        assert received == down

    run_scenario(scenario())


def test_connection_when_its_message_has_too_many_parts_is_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        assert await relay(tmp_path, HELLO + 1000 * zmtp_frame(b"part", MORE)) == b""

    run_scenario(scenario())


def test_connection_when_not_of_zmtp_3_is_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        assert await relay(tmp_path, b"GET / HTTP/1.1\r\n".ljust(100)) == b""

    run_scenario(scenario())


def test_connection_when_the_client_disconnects_ends_after_its_last_bytes(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as guard:
            with connect_client(guard.port) as end:
                reader, writer = await guard.accepted.get()
                end.send(HELLO)
            assert await reader.read() == HELLO
            writer.close()

    run_scenario(scenario())


def test_connection_when_the_router_ends_it_is_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as guard:
            with connect_client(guard.port) as end:
                _, writer = await guard.accepted.get()
                writer.write(b"last bytes")
                writer.close()
                loop = asyncio.get_running_loop()
                assert await loop.sock_recv(end, 100) == b"last bytes"
                assert await loop.sock_recv(end, 100) == b""

    run_scenario(scenario())


def test_client_when_it_reads_nothing_blocks_the_inside(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as guard:
            with socket.socket() as unread:
                unread.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
                unread.connect((HOST, guard.port))
                _, writer = await guard.accepted.get()
                assert await write_until_blocked(writer) < 100
                writer.transport.abort()

    run_scenario(scenario())


def test_connection_when_the_limit_is_reached_is_closed_and_those_with_requests_stay(
    tmp_path: Path,
) -> None:
    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        async with open_guard(tmp_path, ConnectionLimits(max_connections=1)) as guard:
            with connect_client(guard.port) as first:
                reader, writer = await guard.accepted.get()
                first.send(HELLO + REQUEST)
                assert await reader.readexactly(len(HELLO + REQUEST)) == HELLO + REQUEST
                with connect_client(guard.port) as second:
                    assert await loop.sock_recv(second, 1) == b""
                first.send(REQUEST)
                assert await reader.readexactly(len(REQUEST)) == REQUEST
            assert await reader.read() == b""
            with connect_client(guard.port):  # below the limit again
                _, other = await guard.accepted.get()
            for end in (writer, other):
                end.close()

    run_scenario(scenario())


def test_connection_without_a_request_makes_room_at_the_limit(tmp_path: Path) -> None:
    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        async with open_guard(tmp_path, ConnectionLimits(max_connections=2)) as guard:
            with connect_client(guard.port) as oldest, connect_client(guard.port) as newer:
                ends = [await guard.accepted.get() for _ in range(2)]
                for end in (oldest, newer):
                    end.send(HELLO)  # a handshake alone keeps no place
                with connect_client(guard.port):
                    ends.append(await guard.accepted.get())
                    assert await loop.sock_recv(oldest, 1) == b""
                    newer.send(REQUEST)
                    assert await ends[1][0].readexactly(len(HELLO + REQUEST)) == HELLO + REQUEST
            for _, writer in ends:
                writer.close()

    run_scenario(scenario())


def test_connection_without_a_request_in_time_is_closed_and_others_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_guard, "_CHECK_INTERVAL_S", 0.01)

    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        async with open_guard(tmp_path, ConnectionLimits(handshake_timeout_s=0.2)) as guard:
            with connect_client(guard.port) as served, connect_client(guard.port) as idle:
                served.send(HELLO + REQUEST)
                idle.send(HELLO)
                ends = [await guard.accepted.get() for _ in range(2)]
                assert await loop.sock_recv(idle, 1) == b""
                served.send(REQUEST)
                size = len(HELLO + REQUEST + REQUEST)
                assert len(await ends[0][0].readexactly(size)) == size
            for _, writer in ends:
                writer.close()

    run_scenario(scenario())


def test_connection_when_the_router_ends_it_and_the_client_reads_nothing_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_guard, "_CHECK_INTERVAL_S", 0.01)

    async def scenario() -> None:
        async with open_guard(tmp_path) as guard:
            with socket.socket() as unread:
                unread.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
                unread.connect((HOST, guard.port))
                _, writer = await guard.accepted.get()
                await write_until_blocked(writer)
                writer.transport.abort()
                # A reset, which an ordinary close after the last bytes would not be.
                unread.setblocking(False)
                end_poll = select.poll()
                end_poll.register(unread, 0)
                await wait_until(lambda: bool(end_poll.poll(0)), "reset of the connection")

    run_scenario(scenario())


def test_flood_of_messages_is_held_back_and_single_ones_pass_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_guard, "_MESSAGE_COST_S", 0.01)

    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        async with open_guard(tmp_path) as guard:
            with connect_client(guard.port) as flooding, connect_client(guard.port) as other:
                ends = [await guard.accepted.get() for _ in range(2)]
                flood = asyncio.create_task(loop.sock_sendall(flooding, HELLO + 100_000 * REQUEST))
                other.send(HELLO)
                await ends[1][0].readexactly(len(HELLO))
                for _ in range(3):
                    other.send(REQUEST)
                    assert await ends[1][0].readexactly(len(REQUEST)) == REQUEST
                # The first read of 1 KiB is 100 messages: 1 s of work, that may take 7 s.
                with pytest.raises(TimeoutError):
                    await asyncio.wait_for(ends[0][0].readexactly(1025), 0.3)
                flood.cancel()
            for _, writer in ends:
                writer.close()

    run_scenario(scenario())


def test_connection_when_there_is_no_router_is_closed(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as guard:
            (tmp_path / "inside").unlink()
            with connect_client(guard.port) as end:
                assert await asyncio.get_running_loop().sock_recv(end, 1) == b""

    run_scenario(scenario())


def test_connections_when_the_guard_closes_are_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as guard:
            end = socket.create_connection((HOST, guard.port))
            reader, writer = await guard.accepted.get()
        assert await reader.read() == b""
        writer.close()
        with end:
            assert end.recv(1) == b""

    run_scenario(scenario())
