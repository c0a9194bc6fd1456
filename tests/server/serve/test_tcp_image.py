"""The image port over the loopback, with frames rendered on request."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import numpy as np
import pytest

from catoptra_client.frame_sources.image_client import rgb_from_encoded_frame
from catoptra_protocol.usarsim.image_port import EncodedFrame, ImageFrameReader, ImageType
from catoptra_server.frames.frame import Frame, FrameRequested
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.serve.limits import LoopAccount, LoopShare
from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.tcp_image import ImageOptions, serve_images
from catoptra_server.serve.tcp_server import TcpConnection, TcpServer
from catoptra_server.simulation.events import SimulationEvent
from helpers.loopback import HOST, abort, connect, connect_without_reading, wait_until

RAW = ImageOptions(ImageType.RAW)


class CountingCamera:
    """Renders at once on request: every byte of an image is the number of its frame."""

    def __init__(self, width: int = 8, height: int = 6) -> None:
        self.num_rendered = 0
        self.mailboxes: Mailboxes | None = None
        self._shape = (height, width, 3)
        self.renders = True
        self.refusal = ""

    def post(self, event: SimulationEvent) -> bool:
        if not isinstance(event, FrameRequested):
            return True
        assert self.mailboxes is not None
        if self.refusal:
            self.mailboxes.fail(event.channel, self.refusal)
        elif self.renders:
            self._render(event)
        return True

    def _render(self, event: FrameRequested) -> None:
        self.num_rendered += 1
        rgb = np.full(self._shape, self.num_rendered % 256, dtype=np.uint8)
        rgb[0, 0] = (10, 20, 30)
        assert self.mailboxes is not None
        self.mailboxes.put(Frame(self.num_rendered, 0.0, rgb, 0.0, 0.0, channel=event.channel))


@asynccontextmanager
async def serve_camera(
    camera: CountingCamera, options: ImageOptions = RAW, *, prefetch: bool = False
) -> AsyncIterator[TcpServer]:
    camera.mailboxes = Mailboxes(camera.post, prefetch=prefetch)
    async with serve_images(HOST, 0, mailboxes=camera.mailboxes, options=options) as server:
        yield server


async def read_frames(reader: asyncio.StreamReader, count: int) -> list[EncodedFrame]:
    """Next frames of a connection, with a check that no byte follows."""
    frame_reader, frames = ImageFrameReader(), list[EncodedFrame]()
    while len(frames) < count:
        data = await reader.read(65536)
        assert data, "the server closed"
        frames += frame_reader.receive(data)
    assert len(frames) == count
    return frames


async def test_frame_when_requested_has_type_length_and_image() -> None:
    async with serve_camera(CountingCamera()) as server:
        reader, writer = await connect(server)
        writer.write(b"OK")
        header = await reader.readexactly(9)
        assert header == struct.pack(">BIHH", 0, 4 + 6 * 24, 8, 6)
        assert (await reader.readexactly(6 * 24))[:6] == bytes((30, 20, 10, 1, 1, 1))
        writer.close()


@pytest.mark.parametrize("image_type", ImageType, ids=lambda t: t.name)
async def test_frame_of_any_type_has_its_tag(image_type: ImageType) -> None:
    async with serve_camera(CountingCamera(), ImageOptions(image_type)) as server:
        reader, writer = await connect(server)
        writer.write(b"OK")
        (frame,) = await read_frames(reader, 1)
        assert frame.image_type is image_type
        assert rgb_from_encoded_frame(frame).shape == (6, 8, 3)
        writer.close()


async def test_frames_when_requested_in_one_segment_are_different_and_in_order() -> None:
    async with serve_camera(CountingCamera()) as server:
        reader, writer = await connect(server)
        writer.write(5 * b"OK")
        numbers = [rgb_from_encoded_frame(frame)[1, 1, 0] for frame in await read_frames(reader, 5)]
        assert numbers == [1, 2, 3, 4, 5]
        writer.close()


async def test_region_when_requested_is_cropped() -> None:
    async with serve_camera(CountingCamera()) as server:
        reader, writer = await connect(server)
        writer.write(b"U" + struct.pack(">4I", 0, 0, 3, 2))
        (frame,) = await read_frames(reader, 1)
        rgb = rgb_from_encoded_frame(frame)
        assert rgb.shape == (2, 3, 3)
        assert rgb[0, 0].tolist() == [10, 20, 30]
        writer.close()


async def test_client_in_legacy_mode_gets_one_unsolicited_frame() -> None:
    async with serve_camera(
        CountingCamera(), ImageOptions(ImageType.RAW, legacy_mode=True)
    ) as server:
        reader, writer = await connect(server)
        await read_frames(reader, 1)
        writer.write(b"OK")
        await read_frames(reader, 1)
        writer.close()


async def test_client_when_it_requests_nothing_costs_no_frame() -> None:
    camera = CountingCamera()
    async with serve_camera(camera) as server:
        _, writer = await connect(server)
        reader, requesting = await connect(server)
        requesting.write(b"OK")
        await read_frames(reader, 1)
        assert camera.num_rendered == 1
        writer.close()
        requesting.close()


async def test_clients_when_many_request_at_once_each_get_a_frame() -> None:
    async with serve_camera(CountingCamera(), prefetch=True) as server:
        ends = [await connect(server) for _ in range(8)]
        for _, writer in ends:
            writer.write(b"OK")
        for reader, writer in ends:
            await read_frames(reader, 1)
            writer.close()


@pytest.mark.parametrize(
    "garbage",
    [
        bytes(b for b in np.random.default_rng(1).bytes(100_000) if b not in b"OU"),
        100_000 * b"x",
        1000 * b"Ox",
        b"ok\r\n" + 65536 * b"{",
        b"",
    ],
    ids=["random", "no line end", "discarded pairs", "braces", "nothing"],
)
async def test_garbage_when_sent_has_no_reply_and_the_next_request_has(garbage: bytes) -> None:
    async with serve_camera(CountingCamera()) as server:
        reader, writer = await connect(server)
        writer.write(garbage + b"OK")
        (frame,) = await read_frames(reader, 1)
        assert rgb_from_encoded_frame(frame)[1, 1, 0] == 1
        writer.close()


async def test_bytes_when_random_never_affect_another_client() -> None:
    async with serve_camera(CountingCamera()) as server:
        (_, malformed), (reader, writer) = await connect(server), await connect(server)
        malformed.write(np.random.default_rng(2).bytes(5000))
        for _ in range(20):
            writer.write(b"OK")
            await read_frames(reader, 1)
        abort(malformed)
        writer.close()


async def test_client_when_another_disconnects_mid_frame_is_served() -> None:
    async with serve_camera(
        CountingCamera(2000, 1000)
    ) as server:  # 6 MB: more than a socket accepts at once
        (lost_reader, lost_writer), (reader, writer) = (
            await connect(server),
            await connect(server),
        )
        lost_writer.write(b"OK")
        await lost_reader.readexactly(1000)
        abort(lost_writer)
        writer.write(b"OKOK")
        await read_frames(reader, 2)
        writer.close()


async def test_client_when_another_never_reads_is_served() -> None:
    camera = CountingCamera(2000, 1000)
    async with serve_camera(camera) as server:
        unread = await connect_without_reading(server)
        await asyncio.get_running_loop().sock_sendall(unread, 100 * b"OK")
        reader, writer = await connect(server)
        for _ in range(10):
            writer.write(b"OK")
            await read_frames(reader, 1)
        # The other client's frames were rendered until its buffers were full, not a hundred.
        assert camera.num_rendered < 20
        writer.close()
        unread.close()


@pytest.mark.parametrize("leave", [asyncio.StreamWriter.close, abort], ids=["close", "reset"])
async def test_viewer_that_leaves_while_it_waits_is_noticed(
    leave: Callable[[asyncio.StreamWriter], None],
) -> None:
    camera = CountingCamera()
    camera.renders = False
    async with serve_camera(camera) as server:
        for i in range(100):
            _, writer = await connect(server)
            # Requests that are read, and some that remain in the kernel.
            writer.write((1 if i % 2 else 5000) * b"OK")
            await writer.drain()
            leave(writer)
        # Before: for ever, with a descriptor each.
        await wait_until(lambda: not server.num_connections, "end of the viewers")


async def test_frames_before_a_half_close_are_sent() -> None:
    async with serve_camera(CountingCamera()) as server:
        reader, writer = await connect(server)
        writer.write(3 * b"OK")
        writer.write_eof()
        await read_frames(reader, 3)
        assert await reader.read() == b""
        writer.close()


async def test_viewer_of_an_image_that_cannot_be_rendered_is_disconnected_with_a_log_line(
    caplog: pytest.LogCaptureFixture,
) -> None:
    camera = CountingCamera()
    async with serve_camera(camera) as server:
        reader, writer = await connect(server)
        writer.write(b"OK")
        await read_frames(reader, 1)
        camera.refusal = "the renderer failed"
        writer.write(b"OK")
        assert await reader.read() == b""
        camera.refusal = ""
        again_in, again_out = await connect(server)
        again_out.write(b"OK")
        await read_frames(again_in, 1)
        writer.close()
        again_out.close()
    assert "disconnected: no frame: the renderer failed" in caplog.text
    assert "Traceback" not in caplog.text


async def test_web_page_that_posts_requests_is_disconnected_without_a_frame() -> None:
    camera = CountingCamera()
    async with serve_camera(camera) as server:
        reader, writer = await connect(server)
        writer.write(b"POST / HTTP/1.1\r\nHost: x\r\n\r\nOKOK")
        assert await reader.read() == b""
        assert camera.num_rendered == 0
        writer.close()


class _RecordingShare(LoopShare):
    """A share with nothing for floods, and its accounts."""

    def __init__(self) -> None:
        super().__init__(1e-9)
        self.accounts: list[LoopAccount] = []

    def open_account(self, address: str = "", *, max_wait_s: float = 1.0) -> LoopAccount:
        self.accounts.append(super().open_account(address, max_wait_s=max_wait_s))
        return self.accounts[-1]

    def has_waiting_account(self) -> bool:
        """Whether a client is held back."""
        return any(account.remaining_wait_s > 0.0 for account in self.accounts)


@asynccontextmanager
async def serve_in_share(
    share: _RecordingShare,
) -> AsyncIterator[tuple[CountingCamera, socket.socket]]:
    """A camera behind an image port that uses a share, and a client."""
    camera = CountingCamera()
    camera.mailboxes = Mailboxes(camera.post, prefetch=False)
    limits = ConnectionLimits(loop_share=share)
    async with serve_images(
        HOST, 0, mailboxes=camera.mailboxes, options=RAW, limits=limits
    ) as server:
        with socket.create_connection((HOST, server.port)) as client:
            yield camera, client


async def test_client_that_waits_for_each_reply_is_never_held_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    share, write = _RecordingShare(), TcpConnection.write
    async with serve_in_share(share) as (camera, client):

        def write_and_request(connection: TcpConnection, data: bytes | memoryview) -> None:
            """Write a reply that the client answers at once."""
            write(connection, data)
            client.sendall(b"OK")

        monkeypatch.setattr(TcpConnection, "write", write_and_request)
        client.sendall(b"OK")
        await wait_until(lambda: camera.num_rendered > 50, "frames")
        assert not share.has_waiting_account()


async def test_client_that_sends_requests_before_the_replies_is_held_back() -> None:
    share = _RecordingShare()
    async with serve_in_share(share) as (_, client):
        # Twelve reads with a request in each; other bytes are ignored.
        client.sendall(12 * b"OK".ljust(4096, b"-"))
        await wait_until(share.has_waiting_account, "pause of a client that floods")


async def test_client_that_sends_single_bytes_without_a_request_is_held_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    share, read = _RecordingShare(), TcpConnection.read
    async with serve_in_share(share) as (_, client):

        async def send_and_read(connection: TcpConnection) -> bytes:
            client.sendall(b"-")
            return await read(connection)

        monkeypatch.setattr(TcpConnection, "read", send_and_read)
        client.sendall(b"-")
        await wait_until(share.has_waiting_account, "pause of a client that floods")
