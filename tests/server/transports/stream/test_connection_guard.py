"""The connection guard: unchanged bytes, rejected connections, and complete clean-up."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from catoptra_server.transports.stream import connection_guard
from catoptra_server.transports.stream.connection_guard import ConnectionGuard, create_listener
from helpers.loopback import HOST, SMALL_BUFFER_BYTES, Streams, run_scenario
from helpers.zmtp import GREETING, MORE, READY, zmtp_frame

HELLO = GREETING + READY


class ExhaustedListener:
    """A listening socket whose system has no descriptor for the first connection."""

    def __init__(self) -> None:
        self._listener = create_listener(HOST, 0)
        self.fileno = self._listener.fileno
        self.getsockname = self._listener.getsockname
        self.close = self._listener.close
        self.num_failed = 0

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        if not self.num_failed:
            self.num_failed += 1
            raise OSError(errno.EMFILE, "Too many open files")
        return self._listener.accept()


Listener = socket.socket | ExhaustedListener


@dataclass
class GuardedPort:
    """An open guard: its port, and its connections to the inside."""

    port: int
    accepted: asyncio.Queue[Streams]


@asynccontextmanager
async def open_guard(folder: Path, listener: Listener | None = None) -> AsyncIterator[GuardedPort]:
    accepted: asyncio.Queue[Streams] = asyncio.Queue()
    path = str(folder / "inside")
    server = await asyncio.start_unix_server(lambda *ends: accepted.put_nowait(ends), path)
    bound = listener or create_listener(HOST, 0)
    guard = ConnectionGuard(bound, path)
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
        up = HELLO + 3000 * zmtp_frame(bytes(range(250)))
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
                writer.transport.set_write_buffer_limits(0)
                block, written = bytes(1_000_000), 0
                # Ends when a block stays in this process: the kernel buffers a few megabytes.
                while written < 100 and writer.transport.get_write_buffer_size() == 0:
                    writer.write(block)
                    written += 1
                    for _ in range(100):
                        await asyncio.sleep(0)
                assert written < 100
                writer.transport.abort()

    run_scenario(scenario())


def test_connection_when_the_limit_is_reached_is_closed_and_the_others_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_guard, "MAX_CONNECTIONS", 1)

    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        async with open_guard(tmp_path) as guard:
            with connect_client(guard.port) as first:
                reader, writer = await guard.accepted.get()
                with connect_client(guard.port) as second:
                    assert await loop.sock_recv(second, 1) == b""
                first.send(HELLO)
                assert await reader.readexactly(len(HELLO)) == HELLO
            assert await reader.read() == b""
            with connect_client(guard.port):  # below the limit again
                _, other = await guard.accepted.get()
            for end in (writer, other):
                end.close()

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


def test_connection_when_descriptors_are_exhausted_is_accepted_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_guard, "_ACCEPT_RETRY_S", 0.0)

    async def scenario() -> None:
        listener = ExhaustedListener()
        async with open_guard(tmp_path, listener) as guard:
            with connect_client(guard.port):
                _, writer = await guard.accepted.get()
                writer.close()
        assert listener.num_failed == 1

    run_scenario(scenario())


def test_host_when_unknown_raises_os_error_with_its_name() -> None:
    with pytest.raises(OSError, match=r"stream port no\.such\.host\.invalid:5005: "):
        create_listener("no.such.host.invalid", 5005)
