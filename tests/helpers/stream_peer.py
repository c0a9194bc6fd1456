"""A bare DEALER socket on an asyncio loop: a stream client without any protocol logic."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager

import zmq
import zmq.asyncio

from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import Error, FrameHeader, Heartbeat, Reply
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding, Request


class RawPeer:
    """One connection; `ids` numbers its requests."""

    def __init__(self, socket: zmq.asyncio.Socket) -> None:
        self.socket = socket
        self.ids = itertools.count(1)

    async def send(self, *parts: bytes) -> None:
        """Send a message of raw parts."""
        await self.socket.send_multipart(list(parts))

    async def receive(self) -> tuple[Reply, list[bytes]]:
        """Next message other than a heartbeat, and the parts after its head."""
        while True:
            head, *rest = await self.socket.recv_multipart()
            reply = reply_from_bytes(head)
            if reply is not None and not isinstance(reply, Heartbeat):
                return reply, rest

    async def receive_head(self) -> Reply:
        """Head of the next message, heartbeats included."""
        reply = reply_from_bytes((await self.socket.recv_multipart())[0])
        assert reply is not None
        return reply

    async def send_request(self, request: Request) -> Reply:
        """Send a request; return its reply."""
        await self.send(bytes_from_message(request))
        reply, _ = await self.receive()
        assert getattr(reply, "id", None) == request.id
        return reply

    async def receive_error(self, *parts: bytes) -> Error:
        """Send malformed parts; return the error."""
        await self.send(*parts)
        reply, _ = await self.receive()
        assert isinstance(reply, Error)
        return reply

    async def request_frame(self, encoding: ImageEncoding = ImageEncoding.RAW) -> None:
        """Send a frame request."""
        await self.send(bytes_from_message(GetFrameRequest(next(self.ids), "", "", encoding)))

    async def get_frame(
        self, encoding: ImageEncoding = ImageEncoding.RAW
    ) -> tuple[FrameHeader, bytes]:
        """Send a frame request; return header and image."""
        await self.request_frame(encoding)
        header, (image,) = await self.receive()
        assert isinstance(header, FrameHeader)
        return header, image


@contextmanager
def connect_raw_peer(
    port: int, *, high_water_mark: int = 1000, identity: bytes = b""
) -> Iterator[RawPeer]:
    """Connect to a stream on the loopback.

    Args:
        port: TCP port.
        high_water_mark: Messages that may wait unread on this side.
        identity: Identity of the socket; empty for one that the server chooses.
    """
    context = zmq.asyncio.Context()
    socket = context.socket(zmq.DEALER)
    try:
        socket.set(zmq.LINGER, 0)
        if identity:
            socket.set(zmq.IDENTITY, identity)
        socket.set(zmq.RCVHWM, high_water_mark)
        # A small mark only limits ZeroMQ's queue; the kernel's buffer would hold many more.
        if high_water_mark < 10:
            socket.set(zmq.RCVBUF, 4096)
        socket.connect(f"tcp://127.0.0.1:{port}")
        yield RawPeer(socket)
    finally:
        context.destroy(linger=0)
