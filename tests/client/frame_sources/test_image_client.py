"""The image client against a scripted server."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from catoptra_client.frame_sources.image_client import ImageClient, Pixels, rgb_from_encoded_frame
from catoptra_protocol.errors import ConnectionLostError, RemoteProtocolError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES
from catoptra_protocol.usarsim.image_port import (
    EncodedFrame,
    FullFrameRequest,
    ImageType,
    encode_frame_header,
    encode_raw_header,
)
from client.scripted_server import ScriptedImagePeer, serve_script, wait_for_close

# A timeout that expires in the test.
SHORT_S = 0.05


def make_flat_image(value: int, width: int = 6, height: int = 4) -> Pixels:
    """Image of (value, 20, 240) everywhere: red identifies the frame, blue is high."""
    return np.full((height, width, 3), (value, 20, 240), np.uint8)


def raw_payload(rgb: Pixels, pitch: int | None = None) -> bytes:
    """RAW payload of an image, rows padded to the pitch."""
    height, width, _ = rgb.shape
    padding = bytes(-3 * width % 4 if pitch is None else pitch - 3 * width)
    return encode_raw_header(width, height) + b"".join(
        row[:, ::-1].tobytes() + padding for row in rgb
    )


def raw_frame(value: int) -> bytes:
    payload = raw_payload(make_flat_image(value))
    return encode_frame_header(ImageType.RAW, len(payload)) + payload


def frame_script(*frames: bytes, unsolicited: bytes = b"") -> Callable[[socket.socket], None]:
    """Script that replies to each request with the next frame."""

    def script(connection: socket.socket) -> None:
        images = ScriptedImagePeer(connection)
        images.send(unsolicited)
        for frame in frames:
            assert images.receive_request() == FullFrameRequest()
            images.send(frame)
        wait_for_close(connection)

    return script


def red_level(frame_rgb: Pixels) -> int:
    return int(frame_rgb[0, 0, 0])


@pytest.mark.parametrize("pitch", [20, 18])
def test_rgb_when_raw_and_rows_padded_or_not_is_the_image(pitch: int) -> None:
    image = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    rgb = rgb_from_encoded_frame(EncodedFrame(ImageType.RAW, raw_payload(image, pitch)))
    assert np.array_equal(rgb, image)
    assert not rgb.flags.writeable
    assert rgb.flags.c_contiguous


def test_rgb_when_jpeg_has_red_first() -> None:
    image = make_flat_image(200, 32, 16)
    encoded, payload = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])
    assert encoded
    rgb = rgb_from_encoded_frame(EncodedFrame(ImageType.SUPER, payload.tobytes()))
    assert rgb.shape == (16, 32, 3)
    # Quality 100 still rounds in YCbCr: three levels.
    assert np.abs(rgb.astype(int) - image).max() <= 3
    assert not rgb.flags.writeable


@pytest.mark.parametrize("image_type", [ImageType.RAW, ImageType.GOOD])
def test_rgb_when_the_payload_is_empty_is_an_empty_image(image_type: ImageType) -> None:
    assert rgb_from_encoded_frame(EncodedFrame(image_type, b"")).shape == (0, 0, 3)


def test_rgb_when_raw_has_no_pixels_is_an_empty_image() -> None:
    assert rgb_from_encoded_frame(EncodedFrame(ImageType.RAW, encode_raw_header(0, 0))).size == 0


BAD_FRAMES = [
    (ImageType.RAW, encode_raw_header(6, 4) + bytes(5), "RAW frame"),
    (ImageType.GOOD, b"no jpeg at all", "no JPEG"),
    (ImageType.GOOD, b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03", "expected 1 to"),
    (ImageType.GOOD, b"\xff\xd8\xff\xc0\0\x11\x08\0\x10\0\x10\x03", "cannot be decoded"),
]


@pytest.mark.parametrize(("image_type", "payload", "expected_message"), BAD_FRAMES)
def test_rgb_when_the_payload_is_no_image_raises(
    image_type: ImageType, payload: bytes, expected_message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=expected_message):
        rgb_from_encoded_frame(EncodedFrame(image_type, payload))


def test_frame_when_requested_is_counted_and_timed() -> None:
    with (
        serve_script(frame_script(raw_frame(1), raw_frame(2))) as port,
        socket.create_connection(("127.0.0.1", port)) as connection,
    ):
        client = ImageClient(connection, clock=lambda: 42.0)
        frames = [client.get_frame(), client.get_frame()]
    assert [(red_level(f.rgb), f.sequence) for f in frames] == [(1, 0), (2, 1)]
    assert {(f.received_s, f.image_type) for f in frames} == {(42.0, ImageType.RAW)}


def test_frames_when_iterated_keep_one_request_ahead() -> None:
    def script(connection: socket.socket) -> None:
        images = ScriptedImagePeer(connection)
        images.receive_request()
        for value in range(3):
            images.receive_request()  # the next request is there before this frame is sent
            images.send(raw_frame(value))
        wait_for_close(connection)

    with serve_script(script) as port, ImageClient.connect(port=port) as client:
        frames = list(itertools.islice(client.iter_frames(), 3))
    assert [red_level(frame.rgb) for frame in frames] == [0, 1, 2]


def test_frame_when_iteration_ended_early_skips_pending_frames() -> None:
    with serve_script(frame_script(*map(raw_frame, range(4)))) as port:
        with ImageClient.connect(port=port) as client:
            first = next(iter(client.iter_frames()))  # requests two
            fresh = client.get_frame()  # requests the third
            last = client.get_frame()
    assert [red_level(f.rgb) for f in (first, fresh, last)] == [0, 2, 3]


def test_receive_when_the_server_is_in_legacy_mode_returns_the_unsolicited_frame() -> None:
    with serve_script(frame_script(raw_frame(1), unsolicited=raw_frame(0))) as port:
        with ImageClient.connect(port=port) as client:
            assert red_level(client.receive_frame().rgb) == 0
            assert red_level(client.get_frame().rgb) == 1


def test_receive_when_a_frame_arrives_in_pieces_is_complete() -> None:
    def script(connection: socket.socket) -> None:
        images = ScriptedImagePeer(connection)
        images.receive_request()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in raw_frame(7):
            images.send(bytes([byte]))
        wait_for_close(connection)

    with serve_script(script) as port, ImageClient.connect(port=port) as client:
        assert np.array_equal(client.get_frame().rgb, make_flat_image(7))


def test_receive_when_an_image_is_large_is_complete() -> None:
    image = np.random.default_rng(1).integers(0, 256, (640, 640, 3), np.uint8)
    payload = raw_payload(image)
    data = encode_frame_header(ImageType.RAW, len(payload)) + payload
    with serve_script(frame_script(data, data)) as port, ImageClient.connect(port=port) as client:
        assert np.array_equal(client.get_frame().rgb, image)
        assert np.array_equal(client.get_frame().rgb, image)


def test_receive_when_no_frame_arrives_lists_possible_causes() -> None:
    with (
        serve_script(wait_for_close) as port,
        ImageClient.connect(port=port, timeout_s=SHORT_S) as client,
        pytest.raises(ConnectionLostError, match="is this the image port"),
    ):
        client.get_frame()


def test_receive_when_the_server_disconnects_mid_frame_raises() -> None:
    def script(connection: socket.socket) -> None:
        ScriptedImagePeer(connection).receive_request()
        connection.sendall(raw_frame(1)[:-1])

    with serve_script(script) as port, ImageClient.connect(port=port) as client:
        with pytest.raises(ConnectionLostError, match="closed the connection"):
            client.get_frame()


def test_receive_when_the_frame_is_too_large_raises() -> None:
    header = encode_frame_header(ImageType.RAW, MAX_IMAGE_PAYLOAD_BYTES + 1)
    with serve_script(frame_script(header)) as port, ImageClient.connect(port=port) as client:
        with pytest.raises(RemoteProtocolError, match="the limit is"):
            client.get_frame()


def test_connect_when_there_is_no_server_names_the_remedy() -> None:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))  # bound, not listening: the kernel rejects connections
        with pytest.raises(ConnectionLostError, match="--image-port"):
            ImageClient.connect(port=bound.getsockname()[1])
