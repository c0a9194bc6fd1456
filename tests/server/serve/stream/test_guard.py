"""The connection guard: identities, endless messages, backpressure, and complete clean-up."""

from __future__ import annotations

import asyncio
import select
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.serve.port import ConnectionLimits, create_listener
from catoptra_server.serve.stream import guard as guard_module
from catoptra_server.serve.stream.guard import (
    ConnectionGuard,
    IdentityFilter,
    Relay,
    ZmtpPartCounter,
)
from helpers.loopback import HOST, SMALL_BUFFER_BYTES, Streams, wait_until
from helpers.zmtp import COMMAND, GREETING, LONG, MORE, READY, zmtp_frame

MAX_PARTS = 8
MESSAGES = zmtp_frame(b"one") + zmtp_frame(b"\x08Identity")
TYPE = b"\x0bSocket-Type\0\0\0\x06DEALER"


def ready(*properties: bytes, flags: int = COMMAND) -> bytes:
    return zmtp_frame(b"\x05READY" + b"".join(properties), flags)


def identity(name: bytes) -> bytes:
    return bytes([len(name)]) + name + b"\0\0\0\x04same"


@pytest.mark.parametrize("piece_bytes", [1, 7, 10_000])
@pytest.mark.parametrize(
    ("sent", "passed"),
    [
        (READY, READY),
        (ready(TYPE, identity(b"Identity")), ready(TYPE, identity(b"X-Unused"))),
        (ready(identity(b"IDENTITY"), TYPE), ready(identity(b"X-Unused"), TYPE)),
        (
            ready(TYPE, identity(b"Identity"), flags=COMMAND | LONG),
            ready(TYPE, identity(b"X-Unused"), flags=COMMAND | LONG),
        ),
        (ready(identity(b"Identity2")), ready(identity(b"Identity2"))),
        (ready(b"\x08Identity\xff"), ready(b"\x08X-Unused\xff")),  # truncated
        (zmtp_frame(identity(b"Identity")), zmtp_frame(identity(b"Identity"))),  # no command
        (zmtp_frame(b"", COMMAND), zmtp_frame(b"", COMMAND)),
    ],
)
def test_identity_is_renamed_and_all_other_bytes_stay(
    sent: bytes, passed: bytes, piece_bytes: int
) -> None:
    data, stream = GREETING + sent + MESSAGES, IdentityFilter()
    pieces = [data[i : i + piece_bytes] for i in range(0, len(data), piece_bytes)]
    assert b"".join(map(stream.feed, pieces)) == GREETING + passed + MESSAGES


def test_ready_when_too_long_is_rejected() -> None:
    with pytest.raises(RemoteProtocolError, match="first command of 2009 bytes"):
        IdentityFilter().feed(GREETING + zmtp_frame(bytes(2000), COMMAND | LONG)[:20])


PART = zmtp_frame(b"part", MORE)
LAST = zmtp_frame(b"last")
PING = zmtp_frame(b"\x04PING\0\0", COMMAND)

VALID = {
    "a message": LAST,
    "empty messages": 100 * zmtp_frame(b""),
    "the maximum of parts": (MAX_PARTS - 1) * PART + LAST,
    "many messages of several parts": 100 * (PART + PART + LAST),
    "long lengths": 100 * (zmtp_frame(bytes(300), LONG | MORE) + zmtp_frame(b"", LONG)),
    "a body that looks like parts": zmtp_frame(PART * 20, LONG),
    "commands between parts": 3 * (PART + PING) + LAST,
    "many commands": 100 * PING,
}
INVALID = {
    "more than the maximum of parts": MAX_PARTS * PART,
    "empty parts": MAX_PARTS * zmtp_frame(b"", MORE),
    "long parts": MAX_PARTS * zmtp_frame(bytes(300), LONG | MORE),
    "parts hidden behind commands": MAX_PARTS * (PING + PART),
    "parts after good messages": 5 * (PART + LAST) + MAX_PARTS * PART,
    "a command with more": zmtp_frame(b"\x04PING\0\0", COMMAND | MORE),
}
PIECES = {"one piece": 10_000_000, "by 7 bytes": 7, "byte by byte": 1}


def feed_pieces(data: bytes, piece_bytes: int) -> None:
    counter = ZmtpPartCounter()
    for start in range(0, len(data), piece_bytes):
        counter.feed(data[start : start + piece_bytes])


@pytest.mark.parametrize("piece_bytes", PIECES.values(), ids=PIECES)
@pytest.mark.parametrize("messages", VALID.values(), ids=VALID)
def test_messages_when_they_end_pass(messages: bytes, piece_bytes: int) -> None:
    feed_pieces(GREETING + READY + messages, piece_bytes)


@pytest.mark.parametrize("piece_bytes", PIECES.values(), ids=PIECES)
@pytest.mark.parametrize("messages", INVALID.values(), ids=INVALID)
def test_message_when_it_has_too_many_parts_raises(messages: bytes, piece_bytes: int) -> None:
    with pytest.raises(RemoteProtocolError, match="parts"):
        feed_pieces(GREETING + READY + messages, piece_bytes)


def test_message_when_it_has_too_many_parts_raises_before_its_bytes_are_passed() -> None:
    counter = ZmtpPartCounter()
    counter.feed(GREETING + READY + (MAX_PARTS - 1) * PART)
    with pytest.raises(RemoteProtocolError, match="more than 8 parts"):
        counter.feed(PART[:2])


OTHER_GREETINGS = {
    "no ZeroMQ": b"INIT {ClassName USARBot.P2AT}\r\n".ljust(64),
    "a short first part of ZMTP 1": b"\xff" + bytes(63),
    "ZMTP 2": b"\xff" + bytes(8) + b"\x7f\x01" + bytes(53),
}


@pytest.mark.parametrize("greeting", OTHER_GREETINGS.values(), ids=OTHER_GREETINGS)
def test_greeting_when_not_of_zmtp_3_raises(greeting: bytes) -> None:
    with pytest.raises(RemoteProtocolError, match="no greeting of ZMTP 3"):
        feed_pieces(greeting, 64)


@pytest.mark.parametrize("piece_bytes", PIECES.values(), ids=PIECES)
@pytest.mark.parametrize(
    ("data", "num_messages", "num_parts"),
    [
        (b"", 0, 1),
        (PING, 0, 2),
        (PART + PING, 0, 3),
        (PART + LAST, 1, 3),
        (LAST[:-1], 0, 2),
        (3 * zmtp_frame(b""), 3, 4),
        (zmtp_frame(bytes(300), LONG) + LAST, 2, 3),
    ],
)
def test_messages_are_counted_when_they_are_complete(
    data: bytes, num_messages: int, num_parts: int, piece_bytes: int
) -> None:
    counter = ZmtpPartCounter()
    whole = GREETING + READY + data
    for start in range(0, len(whole), piece_bytes):
        counter.feed(whole[start : start + piece_bytes])
    assert (counter.num_messages, counter.num_parts) == (num_messages, num_parts)


class RelayFixture:
    """A relay between two pairs of sockets; the test holds `near` and `far`."""

    def __init__(self, inspect: Callable[[bytes], tuple[bytes, float]]) -> None:
        self.near, source = socket.socketpair()
        sink, self.far = socket.socketpair()
        self.sockets = (self.near, source, sink, self.far)
        for end in self.sockets:
            end.setblocking(False)
        self.ends: list[Exception | None] = []
        self.relay = Relay(source, sink, read_bytes=1000, inspect=inspect, on_end=self.ends.append)


@contextmanager
def open_relay(
    inspect: Callable[[bytes], tuple[bytes, float]] = lambda data: (data, 0.0),
) -> Iterator[RelayFixture]:
    fixture = RelayFixture(inspect)
    try:
        yield fixture
    finally:
        fixture.relay.close()
        for end in fixture.sockets:
            end.close()


async def test_bytes_pass_in_order_whatever_the_sink_accepts() -> None:
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


async def test_source_when_paused_is_read_after_the_pause() -> None:
    pauses = [0.05, 0.0]
    loop = asyncio.get_running_loop()
    with open_relay(lambda data: (data, pauses.pop(0))) as fixture:
        fixture.near.send(bytes(2000))
        begin_s = loop.time()
        assert len(await loop.sock_recv(fixture.far, 10_000)) == 1000
        assert len(await loop.sock_recv(fixture.far, 10_000)) == 1000
        assert loop.time() - begin_s > 0.04
        assert pauses == []


async def test_end_of_the_source_is_reported_after_its_bytes() -> None:
    loop = asyncio.get_running_loop()
    with open_relay() as fixture:
        fixture.near.send(b"last")
        fixture.near.close()
        assert await loop.sock_recv(fixture.far, 100) == b"last"
        await wait_until(lambda: bool(fixture.ends), "end")
        assert fixture.ends[0] is None


async def test_end_of_the_sink_is_reported() -> None:
    with open_relay() as fixture:
        fixture.far.close()
        fixture.near.send(b"data")
        await wait_until(lambda: bool(fixture.ends), "end")
        assert isinstance(fixture.ends[0], BrokenPipeError)


async def test_bytes_when_rejected_are_not_relayed() -> None:
    def reject(data: bytes) -> tuple[bytes, float]:
        raise RemoteProtocolError("bad")

    with open_relay(reject) as fixture:
        fixture.near.send(b"data")
        await wait_until(lambda: bool(fixture.ends), "end")
        assert isinstance(fixture.ends[0], RemoteProtocolError)
        with pytest.raises(BlockingIOError):
            fixture.far.recv(1)


async def test_relay_when_closed_in_a_pause_reads_nothing_more() -> None:
    with open_relay(lambda data: (data, 0.001)) as fixture:
        fixture.near.send(bytes(100))
        await asyncio.get_running_loop().sock_recv(fixture.far, 100)
        fixture.relay.close()
        fixture.near.send(bytes(100))
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.get_running_loop().sock_recv(fixture.far, 100), 0.05)


async def test_relay_when_closed_holds_no_bytes() -> None:
    with open_relay(lambda data: (data, 0.0)) as fixture:
        loop = asyncio.get_running_loop()
        sending = asyncio.create_task(loop.sock_sendall(fixture.near, bytes(10_000_000)))
        await wait_until(lambda: fixture.relay.is_blocked, "bytes that wait for the sink")
        fixture.relay.close()
        assert not fixture.relay.is_blocked
        sending.cancel()


HELLO = GREETING + READY
REQUEST = zmtp_frame(b"request")


@dataclass
class GuardedPort:
    """An open guard: its port, and its connections to the inside."""

    port: int
    accepted: asyncio.Queue[Streams]
    guard: ConnectionGuard


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
        yield GuardedPort(bound.getsockname()[1], accepted, guard)
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
    writer.write(GREETING)
    written = 0
    # The kernel buffers a few megabytes.
    while written < 100 and writer.transport.get_write_buffer_size() == 0:
        writer.write(zmtp_frame(bytes(1_000_000), LONG))
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


async def test_bytes_when_larger_than_every_buffer_pass_both_ways_unchanged(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    up = HELLO + 100 * zmtp_frame(bytes(8 * 1024), LONG)
    down = GREETING + zmtp_frame(bytes(range(256)) * 16_000, LONG)
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


async def test_message_past_the_router_stands_between_two_of_its_messages(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    image = bytes(range(256)) * 20_000
    async with open_guard(tmp_path) as guard:
        with connect_client(guard.port) as end:
            _, writer = await guard.accepted.get()
            (connection,) = guard.guard._port
            torn = zmtp_frame(b"reply")
            writer.write(GREETING + READY + torn[:3])
            assert await loop.sock_recv(end, 1000) == GREETING + READY + torn[:3]
            # In the middle of a reply there is no place.
            assert not connection.send([b"header", memoryview(image)])
            writer.write(torn[3:])
            assert await loop.sock_recv(end, 1000) == torn[3:]
            assert connection.send([b"header", memoryview(image)])
            assert connection.is_client_blocked
            assert not connection.send([b"header", b"next"])
            writer.write(REQUEST)
            sent = zmtp_frame(b"header", MORE) + zmtp_frame(image, LONG) + REQUEST
            received = bytearray()
            while len(received) < len(sent):
                received += await loop.sock_recv(end, 1 << 20)
            assert received == sent
            assert not connection.is_closed
            writer.close()
            await wait_until(lambda: connection.is_closed, "end of the connection")


async def test_connection_when_its_message_has_too_many_parts_is_ended(tmp_path: Path) -> None:
    assert await relay(tmp_path, HELLO + 1000 * zmtp_frame(b"part", MORE)) == b""


async def test_connection_when_not_of_zmtp_3_is_ended(tmp_path: Path) -> None:
    assert await relay(tmp_path, b"GET / HTTP/1.1\r\n".ljust(100)) == b""


async def test_connection_when_the_router_ends_it_is_ended(tmp_path: Path) -> None:
    async with open_guard(tmp_path) as guard:
        with connect_client(guard.port) as end:
            _, writer = await guard.accepted.get()
            writer.write(b"last bytes")
            writer.close()
            loop = asyncio.get_running_loop()
            assert await loop.sock_recv(end, 100) == b"last bytes"
            assert await loop.sock_recv(end, 100) == b""


async def test_client_when_it_reads_nothing_blocks_the_inside(tmp_path: Path) -> None:
    async with open_guard(tmp_path) as guard:
        with socket.socket() as unread:
            unread.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
            unread.connect((HOST, guard.port))
            _, writer = await guard.accepted.get()
            assert await write_until_blocked(writer) < 100
            writer.transport.abort()


async def test_connection_when_the_limit_is_reached_is_closed_and_those_with_requests_stay(
    tmp_path: Path,
) -> None:
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


async def test_connection_without_a_request_makes_room_at_the_limit(tmp_path: Path) -> None:
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


async def test_connection_without_a_request_in_time_is_closed_and_others_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard_module, "CHECK_INTERVAL_S", 0.01)
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


async def test_connection_when_the_router_ends_it_and_the_client_reads_nothing_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard_module, "CHECK_INTERVAL_S", 0.01)
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


async def test_flood_of_messages_is_held_back_and_single_ones_pass_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard_module, "_MESSAGE_COST_S", 0.01)
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


async def test_connection_when_there_is_no_router_is_closed(tmp_path: Path) -> None:
    async with open_guard(tmp_path) as guard:
        (tmp_path / "inside").unlink()
        with connect_client(guard.port) as end:
            assert await asyncio.get_running_loop().sock_recv(end, 1) == b""


async def test_connections_when_the_guard_closes_are_ended(tmp_path: Path) -> None:
    async with open_guard(tmp_path) as guard:
        end = socket.create_connection((HOST, guard.port))
        reader, writer = await guard.accepted.get()
    assert await reader.read() == b""
    writer.close()
    with end:
        assert end.recv(1) == b""
