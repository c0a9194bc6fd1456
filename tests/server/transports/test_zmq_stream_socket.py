"""The ROUTER socket: what is sent, what is not, and what happens when it cannot be had."""

from __future__ import annotations

import asyncio
import socket

import pytest

from catoptra_server.transports.zmq_stream_socket import RouterSocket, Sent
from helpers.loopback import HOST, play
from helpers.stream_peer import raw_peer


class Router:
    """A socket that keeps what it received."""

    def __init__(self, host: str = HOST) -> None:
        self.received: asyncio.Queue[tuple[bytes, list[bytes]]] = asyncio.Queue()
        self.socket = RouterSocket(
            host, 0, lambda peer, parts: self.received.put_nowait((peer, parts))
        )

    def __enter__(self) -> Router:
        return self

    def __exit__(self, *error: object) -> None:
        self.socket.close()


def test_messages_when_many_come_at_once_are_all_received_in_order() -> None:
    async def scene() -> None:
        with Router() as router, raw_peer(router.socket.port) as peer:
            for number in range(100):
                await peer.send(b"%d" % number, b"more")
            got = [(await router.received.get())[1] for _ in range(100)]
            assert got == [[b"%d" % number, b"more"] for number in range(100)]

    play(scene())


def test_message_when_sent_between_receptions_loses_none() -> None:
    async def scene() -> None:
        with Router() as router, raw_peer(router.socket.port) as peer:
            for _ in range(50):
                await peer.send(b"ping")
                identity, _ = await router.received.get()
                assert router.socket.send(identity, [b"pong"]) is Sent.YES
                assert await peer.socket.recv_multipart() == [b"pong"]

    play(scene())


def test_messages_when_the_peer_reads_as_fast_as_they_come_are_all_sent() -> None:
    async def scene() -> None:
        with Router() as router, raw_peer(router.socket.port) as peer:
            for _ in range(2000):  # without a look at what was taken, one in hundreds is refused
                await peer.send(b"ping")
                identity, _ = await router.received.get()
                assert router.socket.send(identity, [b"pong"]) is Sent.YES
                assert await peer.socket.recv_multipart() == [b"pong"]

    play(scene())


def test_message_when_the_peer_was_never_there_is_not_sent() -> None:
    async def scene() -> None:
        with Router() as router:
            assert router.socket.send(b"nobody", [b"a"]) is Sent.PEER_IS_GONE

    play(scene())


def test_messages_when_the_peer_reads_nothing_end_in_full() -> None:
    async def scene() -> None:
        with Router() as router, raw_peer(router.socket.port, keeps=1) as peer:
            await peer.send(b"here")
            identity, _ = await router.received.get()
            sent = [router.socket.send(identity, [bytes(1_000_000)]) for _ in range(100)]
            assert sent[0] is Sent.YES
            assert sent[-1] is Sent.PEER_IS_FULL

    play(scene())


def test_port_when_in_use_raises_os_error_that_names_it() -> None:
    async def scene() -> None:
        with socket.create_server((HOST, 0)) as taken:
            port = taken.getsockname()[1]
            with pytest.raises(OSError, match=f"stream port 127.0.0.1:{port}: Address already"):
                RouterSocket(HOST, port, print)

    play(scene())


def test_host_when_a_name_is_resolved() -> None:
    async def scene() -> None:
        with Router("localhost") as router:
            assert router.socket.port > 0

    play(scene())
