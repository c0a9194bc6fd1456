"""Payloads of a frame: each encoding computed once, whatever the number of connections."""

from __future__ import annotations

import asyncio

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.frames import encode as encode_module
from catoptra_server.frames.frame import Frame
from helpers.loopback import run_scenario


def make_frame(rgb: npt.NDArray[np.uint8]) -> Frame:
    return Frame(1, 0.0, rgb, 0.0, 0.0)


def make_image(height: int, width: int) -> npt.NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize("encoding", [ImageType.RAW, ImageType.BAD], ids=lambda e: e.name)
def test_image_when_requested_by_several_clients_is_encoded_once(
    encoding: ImageType, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[ImageType] = []

    def encode(rgb: npt.NDArray[np.uint8], encoding: ImageType) -> bytes:
        calls.append(encoding)
        return b"encoded"

    async def scenario() -> None:
        frame = make_frame(make_image(4, 4))
        encoded = await asyncio.gather(*[frame.encode(encoding) for _ in range(8)])
        assert encoded == [b"encoded"] * 8
        assert await frame.encode(encoding) is encoded[0]

    monkeypatch.setattr(encode_module, "encode_image", encode)
    run_scenario(scenario())
    assert calls == [encoding]


def test_client_that_leaves_while_an_image_is_encoded_leaves_the_others_waiting() -> None:
    async def scenario() -> None:
        frame = make_frame(make_image(4, 4))
        gone, stays = (asyncio.create_task(frame.encode(ImageType.GOOD)) for _ in range(2))
        await asyncio.sleep(0)
        gone.cancel()
        assert len(await stays) > 0

    run_scenario(scenario())


def test_jpeg_when_requested_by_both_transports_is_encoded_once() -> None:
    async def scenario() -> None:
        frame = make_frame(make_image(8, 8))
        payload, reply = [await frame.encode(e) for e in (ImageEncoding.JPEG, ImageType.GOOD)]
        assert isinstance(payload, memoryview)
        assert payload.obj is reply
        assert bytes(payload) == reply[-len(payload) :]

    run_scenario(scenario())


def test_png_and_raw_of_the_stream_when_decoded_are_the_image() -> None:
    async def scenario() -> None:
        rgb = make_image(6, 5)
        frame = make_frame(rgb)
        png = cv2.imdecode(
            np.frombuffer(await frame.encode(ImageEncoding.PNG), np.uint8), cv2.IMREAD_COLOR_RGB
        )
        np.testing.assert_array_equal(png, rgb)
        raw = np.frombuffer(await frame.encode(ImageEncoding.RAW), np.uint8).reshape(rgb.shape)
        np.testing.assert_array_equal(raw, rgb)

    run_scenario(scenario())
