"""A WebSocket of the live page in the place of a socket of the stream, and the page's documents.

Messages are JSON here (SPEC.md 9.9, 10) and maps of msgpack to the client above: so each check of
the stream is one of the page, too.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, cast

import aiohttp
import msgpack

from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from catoptra_protocol.errors import ConnectionLostError, RemoteProtocolError
from conformance.check import ServerUnderTest
from conformance.conversation_file import Address

PAGE_TIMEOUT_S = 10.0


class PageSocket:
    """A WebSocket, used from one thread."""

    def __init__(self, address: Address) -> None:
        host, port = address
        self.address = f"{host}:{port}"
        self._loop = asyncio.new_event_loop()
        self._session, self._socket = self._run(self._connect(f"http://{self.address}"))

    async def _connect(
        self, url: str
    ) -> tuple[aiohttp.ClientSession, aiohttp.ClientWebSocketResponse]:
        session = aiohttp.ClientSession()
        return session, await session.ws_connect(f"{url}/socket", origin=url, max_msg_size=0)

    def _run(self, work: Any) -> Any:
        return self._loop.run_until_complete(asyncio.wait_for(work, PAGE_TIMEOUT_S))

    def begin_wait(self) -> None:
        """Nothing: pings take the place of heartbeats."""

    def check_alive(self) -> None:
        """Nothing, likewise."""

    def close(self) -> None:
        """End the WebSocket."""
        if not self._loop.is_closed():
            self._run(self._socket.close())
            self._run(self._session.close())
            # Transports close in the iteration of the loop after.
            self._run(self._loop.shutdown_asyncgens())
            self._loop.close()

    def send(self, data: bytes, deadline_s: float) -> None:
        """Send a request of the client above."""
        self.send_message(json.dumps(msgpack.unpackb(data)))

    def send_message(self, data: str | bytes) -> None:
        """Send a text or a binary message."""
        send = self._socket.send_str if isinstance(data, str) else self._socket.send_bytes
        self._run(send(data))

    def receive(self, deadline_s: float) -> list[bytes] | None:
        """Parts of the next message; None if none comes in time."""
        timeout_s = max(deadline_s - time.monotonic(), 0.0)
        try:
            message = self._run(self._socket.receive(timeout_s))
        except TimeoutError:
            return None
        if message.type is aiohttp.WSMsgType.TEXT:
            return [msgpack.packb(json.loads(message.data))]
        if message.type is aiohttp.WSMsgType.BINARY:
            return _parts_of_frame(message.data)
        raise ConnectionLostError(f"{self.address} ended the WebSocket: {self._socket.close_code}")

    def receive_close(self) -> int | None:
        """Code with which the server ends the WebSocket; None if it sends a message instead."""
        message = self._run(self._socket.receive(PAGE_TIMEOUT_S))
        is_message = message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY)
        return None if is_message else self._socket.close_code


def _parts_of_frame(data: bytes) -> list[bytes]:
    """Header, image and channels of a binary message."""
    length = int.from_bytes(data[:4], "little")
    header, rest = json.loads(data[4 : 4 + length]), data[4 + length :]
    if header.get("kind") != "frame":
        raise RemoteProtocolError(f"a binary message of the kind {header.get('kind')}")
    sizes = [one["num_bytes"] for one in (header.get("labels") or {}).get("channels", ())]
    parts = [rest[: len(rest) - sum(sizes)]]
    position = len(parts[0])
    for size in sizes:
        parts.append(rest[position : position + size])
        position += size
    return [msgpack.packb(header), *parts]


def on_page(server: ServerUnderTest) -> ServerUnderTest:
    """The server as checks of the stream see it through WebSockets of its page."""
    address = server.addresses["page"]

    def replace_socket(socket: StreamSocket) -> StreamSocket:
        socket.close()
        return cast(StreamSocket, PageSocket(address))

    # A replay has its own.
    own = server.replace_socket or replace_socket
    return replace(server, addresses={"stream": address}, replace_socket=own)


@contextmanager
def open_page(server: ServerUnderTest) -> Iterator[PageSocket]:
    """A WebSocket of the page for the length of a block."""
    socket = PageSocket(server.addresses["page"])
    try:
        yield socket
    finally:
        socket.close()


def request_page(
    server: ServerUnderTest, path: str, method: str = "GET", **options: Any
) -> tuple[int, str]:
    """Status and text of a response of the page."""
    host, port = server.addresses["page"]

    async def work() -> tuple[int, str]:
        async with (
            aiohttp.ClientSession() as session,
            session.request(method, f"http://{host}:{port}{path}", **options) as response,
        ):
            return response.status, await response.text()

    return asyncio.run(asyncio.wait_for(work(), PAGE_TIMEOUT_S))


def get_document(server: ServerUnderTest, path: str) -> dict[str, Any]:
    """JSON document of the page."""
    document: dict[str, Any] = json.loads(request_page(server, path)[1])
    return document if server.change_document is None else server.change_document(path, document)
