"""A bare DEALER socket on an asyncio loop: a stream client that knows only bytes."""

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
    """One connection; `ids` gives the numbers of requests."""

    def __init__(self, socket: zmq.asyncio.Socket) -> None:
        self.socket = socket
        self.ids = itertools.count(1)

    async def send(self, *parts: bytes) -> None:
        """Send a message as it is."""
        await self.socket.send_multipart(list(parts))

    async def receive(self) -> tuple[Reply, list[bytes]]:
        """Return the next message that is no pulse, and the parts behind it."""
        while True:
            head, *rest = await self.socket.recv_multipart()
            answer = reply_from_bytes(head)
            if answer is not None and not isinstance(answer, Heartbeat):
                return answer, rest

    async def receive_head(self) -> Reply:
        """Return the head of the next message, pulses included."""
        answer = reply_from_bytes((await self.socket.recv_multipart())[0])
        assert answer is not None
        return answer

    async def send_request(self, request: Request) -> Reply:
        """Send a request; return its answer."""
        await self.send(bytes_from_message(request))
        answer, _ = await self.receive()
        assert getattr(answer, "id", None) == request.id
        return answer

    async def receive_error(self, *parts: bytes) -> str:
        """Send parts that cannot be read; return what is said about them."""
        await self.send(*parts)
        answer, _ = await self.receive()
        assert isinstance(answer, Error)
        assert answer.id == 0
        return answer.reason

    async def request_frame(self, encoding: ImageEncoding = ImageEncoding.RAW) -> None:
        """Ask for a frame."""
        await self.send(bytes_from_message(GetFrameRequest(next(self.ids), "", "", encoding)))

    async def get_frame(
        self, encoding: ImageEncoding = ImageEncoding.RAW
    ) -> tuple[FrameHeader, bytes]:
        """Ask for a frame and return it."""
        await self.request_frame(encoding)
        header, (picture,) = await self.receive()
        assert isinstance(header, FrameHeader)
        return header, picture


@contextmanager
def connect_raw_peer(port: int, *, high_water_mark: int = 1000) -> Iterator[RawPeer]:
    """Connect to a stream on the loopback; keeps: how many messages wait unread on this side."""
    context = zmq.asyncio.Context()
    socket = context.socket(zmq.DEALER)
    try:
        socket.set(zmq.LINGER, 0)
        socket.set(zmq.RCVHWM, high_water_mark)
        if high_water_mark < 10:
            socket.set(zmq.RCVBUF, 4096)
        socket.connect(f"tcp://127.0.0.1:{port}")
        yield RawPeer(socket)
    finally:
        context.destroy(linger=0)
