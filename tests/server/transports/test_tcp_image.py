"""The image port over the loopback, with a mailbox that is filled when asked."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np
import pytest

from catoptra_client.frame_sources.image_client import rgb_from_encoded_frame
from catoptra_protocol.usarsim.image_port import EncodedFrame, ImageFrameReader, ImageType
from catoptra_server.frames.frame import Frame
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.simulation import FrameRequested, SimulationEvent
from catoptra_server.transports.tcp_image import ImageOptions, serve_images
from helpers.loopback import HOST, abort, connect, connect_without_reading, run_scenario

RAW = ImageOptions(ImageType.RAW)


class CountingCamera:
    """Draws at once when asked: every byte of the picture is the frame's number."""

    def __init__(self, width: int = 8, height: int = 6) -> None:
        self.num_rendered = 0
        self.mailboxes: Mailboxes | None = None
        self._shape = (height, width, 3)

    def post(self, request: SimulationEvent) -> None:
        if not isinstance(request, FrameRequested):
            return
        self.num_rendered += 1
        rgb = np.full(self._shape, self.num_rendered % 256, dtype=np.uint8)
        rgb[0, 0] = (10, 20, 30)
        assert self.mailboxes is not None
        self.mailboxes.put(Frame(self.num_rendered, 0.0, rgb, 0.0, 0.0, channel=request.channel))


@asynccontextmanager
async def serve_camera(
    camera: CountingCamera, options: ImageOptions = RAW, *, prefetch: bool = False
) -> AsyncIterator[asyncio.Server]:
    camera.mailboxes = Mailboxes(camera.post, prefetch=prefetch)
    async with serve_images(HOST, 0, mailboxes=camera.mailboxes, options=options) as server:
        yield server


async def read_frames(reader: asyncio.StreamReader, count: int) -> list[EncodedFrame]:
    """Return the next frames of a connection, and check that no byte follows them."""
    wire, found = ImageFrameReader(), list[EncodedFrame]()
    while len(found) < count:
        data = await reader.read(65536)
        assert data, "the server closed"
        found += wire.receive(data)
    assert len(found) == count
    return found


def test_frame_when_asked_for_has_type_length_and_picture() -> None:
    async def scenario() -> None:
        async with serve_camera(CountingCamera()) as server:
            reader, writer = await connect(server)
            writer.write(b"OK")
            header = await reader.readexactly(9)
            assert header == struct.pack(">BIHH", 0, 4 + 6 * 24, 8, 6)
            assert (await reader.readexactly(6 * 24))[:6] == bytes((30, 20, 10, 1, 1, 1))
            writer.close()

    run_scenario(scenario())


@pytest.mark.parametrize("image_type", ImageType, ids=lambda t: t.name)
def test_frame_when_of_any_type_says_so(image_type: ImageType) -> None:
    async def scenario() -> None:
        async with serve_camera(CountingCamera(), ImageOptions(image_type)) as server:
            reader, writer = await connect(server)
            writer.write(b"OK")
            (frame,) = await read_frames(reader, 1)
            assert frame.image_type is image_type
            assert rgb_from_encoded_frame(frame).shape == (6, 8, 3)
            writer.close()

    run_scenario(scenario())


def test_frames_when_asked_for_in_one_piece_are_different_and_in_order() -> None:
    async def scenario() -> None:
        async with serve_camera(CountingCamera()) as server:
            reader, writer = await connect(server)
            writer.write(5 * b"OK")
            numbers = [
                rgb_from_encoded_frame(frame)[1, 1, 0] for frame in await read_frames(reader, 5)
            ]
            assert numbers == [1, 2, 3, 4, 5]
            writer.close()

    run_scenario(scenario())


def test_rectangle_when_asked_for_is_cut_out() -> None:
    async def scenario() -> None:
        async with serve_camera(CountingCamera()) as server:
            reader, writer = await connect(server)
            writer.write(b"U" + struct.pack(">4I", 0, 0, 3, 2))
            (frame,) = await read_frames(reader, 1)
            rgb = rgb_from_encoded_frame(frame)
            assert rgb.shape == (2, 3, 3)
            assert rgb[0, 0].tolist() == [10, 20, 30]
            writer.close()

    run_scenario(scenario())


def test_viewer_when_in_legacy_mode_gets_one_frame_unasked() -> None:
    async def scenario() -> None:
        async with serve_camera(
            CountingCamera(), ImageOptions(ImageType.RAW, legacy_mode=True)
        ) as server:
            reader, writer = await connect(server)
            await read_frames(reader, 1)
            writer.write(b"OK")
            await read_frames(reader, 1)
            writer.close()

    run_scenario(scenario())


def test_viewer_when_it_asks_for_nothing_costs_no_picture() -> None:
    async def scenario() -> None:
        camera = CountingCamera()
        async with serve_camera(camera) as server:
            _, writer = await connect(server)
            reader, asking = await connect(server)
            asking.write(b"OK")
            await read_frames(reader, 1)
            assert camera.num_rendered == 1
            writer.close()
            asking.close()

    run_scenario(scenario())


def test_viewers_when_many_ask_at_once_each_get_one() -> None:
    async def scenario() -> None:
        async with serve_camera(CountingCamera(), prefetch=True) as server:
            ends = [await connect(server) for _ in range(8)]
            for _, writer in ends:
                writer.write(b"OK")
            for reader, writer in ends:
                await read_frames(reader, 1)
                writer.close()

    run_scenario(scenario())


@pytest.mark.parametrize(
    "garbage",
    [
        bytes(b for b in np.random.default_rng(1).bytes(100_000) if b not in b"OU"),
        100_000 * b"x",
        1000 * b"Ox",
        b"ok\r\n" + 65536 * b"{",
        b"",
    ],
    ids=["random", "no line end", "swallowed", "braces", "nothing"],
)
def test_garbage_when_sent_is_answered_by_nothing_and_then_served(garbage: bytes) -> None:
    async def scenario() -> None:
        async with serve_camera(CountingCamera()) as server:
            reader, writer = await connect(server)
            writer.write(garbage + b"OK")
            (frame,) = await read_frames(reader, 1)
            assert rgb_from_encoded_frame(frame)[1, 1, 0] == 1
            writer.close()

    run_scenario(scenario())


def test_bytes_when_random_never_break_another_viewer() -> None:
    async def scenario() -> None:
        async with serve_camera(CountingCamera()) as server:
            (_, rude), (reader, writer) = await connect(server), await connect(server)
            rude.write(np.random.default_rng(2).bytes(5000))
            for _ in range(20):
                writer.write(b"OK")
                await read_frames(reader, 1)
            abort(rude)
            writer.close()

    run_scenario(scenario())


def test_viewer_when_another_vanishes_mid_frame_is_served() -> None:
    async def scenario() -> None:
        async with serve_camera(
            CountingCamera(2000, 1000)
        ) as server:  # 6 MB: more than a socket takes at once
            (gone_in, gone_out), (reader, writer) = await connect(server), await connect(server)
            gone_out.write(b"OK")
            await gone_in.readexactly(1000)
            abort(gone_out)
            writer.write(b"OKOK")
            await read_frames(reader, 2)
            writer.close()

    run_scenario(scenario())


def test_viewer_when_another_never_reads_is_served() -> None:
    async def scenario() -> None:
        camera = CountingCamera(2000, 1000)
        async with serve_camera(camera) as server:
            deaf = await connect_without_reading(server)
            await asyncio.get_running_loop().sock_sendall(deaf, 100 * b"OK")
            reader, writer = await connect(server)
            for _ in range(10):
                writer.write(b"OK")
                await read_frames(reader, 1)
            # The deaf one was drawn for until its first frames stuck, not a hundred times.
            assert camera.num_rendered < 20
            writer.close()
            deaf.close()

    run_scenario(scenario())
