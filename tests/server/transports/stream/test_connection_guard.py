"""The port before the ROUTER: what passes unchanged, who is sent away, and that nothing is left."""

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
    """An open turnstile: its port, and the connections that come out of it inside."""

    port: int
    accepted: asyncio.Queue[Streams]


@asynccontextmanager
async def open_guard(folder: Path, listener: Listener | None = None) -> AsyncIterator[GuardedPort]:
    came: asyncio.Queue[Streams] = asyncio.Queue()
    path = str(folder / "inside")
    server = await asyncio.start_unix_server(lambda *ends: came.put_nowait(ends), path)
    port_is_ours = listener or create_listener(HOST, 0)
    gate = ConnectionGuard(port_is_ours, path)
    try:
        yield GuardedPort(port_is_ours.getsockname()[1], came)
    finally:
        gate.close()
        server.close()


@contextmanager
def connect_client(port: int) -> Iterator[socket.socket]:
    """Connect without blocking the loop."""
    with socket.create_connection((HOST, port)) as end:
        end.setblocking(False)
        yield end


async def relay(folder: Path, sent: bytes) -> bytes:
    """Return what of some bytes reached the inside before the connection was ended."""
    async with open_guard(folder) as gate:
        with connect_client(gate.port) as end:
            reader, writer = await gate.accepted.get()
            await asyncio.get_running_loop().sock_sendall(end, sent)
            got = await reader.read()
            writer.close()
            return got


def test_bytes_when_larger_than_every_buffer_pass_both_ways_unchanged(tmp_path: Path) -> None:
    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        up = HELLO + 3000 * zmtp_frame(bytes(range(250)))
        down = bytes(range(256)) * 16_000
        async with open_guard(tmp_path) as gate:
            with connect_client(gate.port) as end:
                reader, writer = await gate.accepted.get()
                sending = asyncio.create_task(loop.sock_sendall(end, up))
                writer.write(down)
                assert await reader.readexactly(len(up)) == up
                got = bytearray()
                while len(got) < len(down):
                    got += await loop.sock_recv(end, 100_000)
                await sending
                writer.close()
        assert got == down

    run_scenario(scenario())


def test_connection_when_its_message_has_too_many_parts_is_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        assert await relay(tmp_path, HELLO + 1000 * zmtp_frame(b"part", MORE)) == b""

    run_scenario(scenario())


def test_connection_when_not_of_zmtp_3_is_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        assert await relay(tmp_path, b"GET / HTTP/1.1\r\n".ljust(100)) == b""

    run_scenario(scenario())


def test_connection_when_the_client_leaves_is_ended_after_its_last_bytes(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as gate:
            with connect_client(gate.port) as end:
                reader, writer = await gate.accepted.get()
                end.send(HELLO)
            assert await reader.read() == HELLO
            writer.close()

    run_scenario(scenario())


def test_connection_when_the_inside_ends_it_is_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as gate:
            with connect_client(gate.port) as end:
                _, writer = await gate.accepted.get()
                writer.write(b"last words")
                writer.close()
                loop = asyncio.get_running_loop()
                assert await loop.sock_recv(end, 100) == b"last words"
                assert await loop.sock_recv(end, 100) == b""

    run_scenario(scenario())


def test_client_when_it_reads_nothing_holds_the_inside_back(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as gate:
            with socket.socket() as deaf:
                deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
                deaf.connect((HOST, gate.port))
                _, writer = await gate.accepted.get()
                writer.transport.set_write_buffer_limits(0)
                block, given = bytes(1_000_000), 0
                # It ends when the block stays here; the kernel holds a few megabytes at most.
                while given < 100 and writer.transport.get_write_buffer_size() == 0:
                    writer.write(block)
                    given += 1
                    for _ in range(100):
                        await asyncio.sleep(0)
                assert given < 100
                writer.transport.abort()

    run_scenario(scenario())


def test_connection_when_there_are_enough_is_closed_and_the_others_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_guard, "MOST_CONNECTIONS", 1)

    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        async with open_guard(tmp_path) as gate:
            with connect_client(gate.port) as first:
                reader, writer = await gate.accepted.get()
                with connect_client(gate.port) as second:
                    assert await loop.sock_recv(second, 1) == b""
                first.send(HELLO)
                assert await reader.readexactly(len(HELLO)) == HELLO
            assert await reader.read() == b""
            with connect_client(gate.port):  # a place is free again
                _, other = await gate.accepted.get()
            for end in (writer, other):
                end.close()

    run_scenario(scenario())


def test_connection_when_nobody_is_inside_is_closed(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as gate:
            (tmp_path / "inside").unlink()
            with connect_client(gate.port) as end:
                assert await asyncio.get_running_loop().sock_recv(end, 1) == b""

    run_scenario(scenario())


def test_connections_when_the_turnstile_closes_are_ended(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_guard(tmp_path) as gate:
            end = socket.create_connection((HOST, gate.port))
            reader, writer = await gate.accepted.get()
        assert await reader.read() == b""
        writer.close()
        with end:
            assert end.recv(1) == b""

    run_scenario(scenario())


def test_connection_when_descriptors_are_short_is_let_in_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_guard, "_ACCEPT_AGAIN_S", 0.0)

    async def scenario() -> None:
        listener = ExhaustedListener()
        async with open_guard(tmp_path, listener) as gate:
            with connect_client(gate.port):
                _, writer = await gate.accepted.get()
                writer.close()
        assert listener.num_failed == 1

    run_scenario(scenario())


def test_host_when_unknown_raises_os_error_that_names_it() -> None:
    with pytest.raises(OSError, match=r"stream port no\.such\.host\.invalid:5005: "):
        create_listener("no.such.host.invalid", 5005)
