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
    raw_row_pitch,
)
from client.scripted_server import ScriptedImagePeer, serve_script, wait_for_close

SHORT_S = 0.05  # a timeout that is meant to pass


def make_flat_picture(value: int, width: int = 6, height: int = 4) -> Pixels:
    """Return a picture of (value, 20, 240) everywhere: red tells the frame, blue is high."""
    return np.full((height, width, 3), (value, 20, 240), np.uint8)


def raw_payload(rgb: Pixels, pitch: int | None = None) -> bytes:
    """Return the RAW payload of a picture, rows padded to the pitch."""
    height, width, _ = rgb.shape
    padding = bytes((raw_row_pitch(width) if pitch is None else pitch) - 3 * width)
    return encode_raw_header(width, height) + b"".join(
        row[:, ::-1].tobytes() + padding for row in rgb
    )


def raw_frame(value: int) -> bytes:
    payload = raw_payload(make_flat_picture(value))
    return encode_frame_header(ImageType.RAW, len(payload)) + payload


def frame_script(*frames: bytes, unsolicited: bytes = b"") -> Callable[[socket.socket], None]:
    """Return a script that answers each request with the next frame."""

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
def test_rgb_when_raw_and_rows_padded_or_not_is_the_picture(pitch: int) -> None:
    picture = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    rgb = rgb_from_encoded_frame(EncodedFrame(ImageType.RAW, raw_payload(picture, pitch)))
    assert np.array_equal(rgb, picture)
    assert not rgb.flags.writeable
    assert rgb.flags.c_contiguous


def test_rgb_when_jpeg_has_red_first() -> None:
    picture = make_flat_picture(200, 32, 16)
    encoded, payload = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])
    assert encoded
    rgb = rgb_from_encoded_frame(EncodedFrame(ImageType.SUPER, payload.tobytes()))
    assert rgb.shape == (16, 32, 3)
    # Quality 100 still rounds in YCbCr: three levels.
    assert np.abs(rgb.astype(int) - picture).max() <= 3
    assert not rgb.flags.writeable


@pytest.mark.parametrize("image_type", [ImageType.RAW, ImageType.GOOD])
def test_rgb_when_the_payload_is_empty_is_an_empty_picture(image_type: ImageType) -> None:
    assert rgb_from_encoded_frame(EncodedFrame(image_type, b"")).shape == (0, 0, 3)


def test_rgb_when_raw_has_no_pixels_is_an_empty_picture() -> None:
    assert rgb_from_encoded_frame(EncodedFrame(ImageType.RAW, encode_raw_header(0, 0))).size == 0


BAD_FRAMES = [
    (ImageType.RAW, encode_raw_header(6, 4) + bytes(5), "RAW frame"),
    (ImageType.GOOD, b"no jpeg at all", "no JPEG"),
    (ImageType.GOOD, b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03", "we accept"),
    (ImageType.GOOD, b"\xff\xd8\xff\xc0\0\x11\x08\0\x10\0\x10\x03", "cannot be decoded"),
]


@pytest.mark.parametrize(("image_type", "payload", "said"), BAD_FRAMES)
def test_rgb_when_the_payload_is_no_picture_refuses(
    image_type: ImageType, payload: bytes, said: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=said):
        rgb_from_encoded_frame(EncodedFrame(image_type, payload))


def test_frame_when_asked_for_is_counted_and_timed() -> None:
    with (
        serve_script(frame_script(raw_frame(1), raw_frame(2))) as port,
        socket.create_connection(("127.0.0.1", port)) as connection,
    ):
        stream = ImageClient(connection, clock=lambda: 42.0)
        frames = [stream.get_frame(), stream.get_frame()]
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

    with serve_script(script) as port, ImageClient.connect(port=port) as stream:
        frames = list(itertools.islice(stream.iter_frames(), 3))
    assert [red_level(frame.rgb) for frame in frames] == [0, 1, 2]


def test_frame_when_frames_were_left_early_passes_over_those_owed() -> None:
    with serve_script(frame_script(*map(raw_frame, range(4)))) as port:
        with ImageClient.connect(port=port) as stream:
            first = next(iter(stream.iter_frames()))  # asks for two
            fresh = stream.get_frame()  # asks for the third
            last = stream.get_frame()
    assert [red_level(f.rgb) for f in (first, fresh, last)] == [0, 2, 3]


def test_receive_when_the_server_is_in_legacy_mode_takes_the_frame_unasked() -> None:
    with serve_script(frame_script(raw_frame(1), unsolicited=raw_frame(0))) as port:
        with ImageClient.connect(port=port) as stream:
            assert red_level(stream.receive_frame().rgb) == 0
            assert red_level(stream.get_frame().rgb) == 1


def test_receive_when_a_frame_is_cut_into_pieces_puts_it_together() -> None:
    def script(connection: socket.socket) -> None:
        images = ScriptedImagePeer(connection)
        images.receive_request()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in raw_frame(7):
            images.send(bytes([byte]))
        wait_for_close(connection)

    with serve_script(script) as port, ImageClient.connect(port=port) as stream:
        assert np.array_equal(stream.get_frame().rgb, make_flat_picture(7))


def test_receive_when_a_picture_is_large_is_whole() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (640, 640, 3), np.uint8)
    payload = raw_payload(picture)
    data = encode_frame_header(ImageType.RAW, len(payload)) + payload
    with serve_script(frame_script(data, data)) as port, ImageClient.connect(port=port) as stream:
        assert np.array_equal(stream.get_frame().rgb, picture)
        assert np.array_equal(stream.get_frame().rgb, picture)


def test_receive_when_no_frame_comes_asks_what_may_be_wrong() -> None:
    with (
        serve_script(wait_for_close) as port,
        ImageClient.connect(port=port, timeout_s=SHORT_S) as stream,
        pytest.raises(ConnectionLostError, match="is this the image port"),
    ):
        stream.get_frame()


def test_receive_when_the_server_vanishes_mid_frame_tells_so() -> None:
    def script(connection: socket.socket) -> None:
        ScriptedImagePeer(connection).receive_request()
        connection.sendall(raw_frame(1)[:-1])

    with serve_script(script) as port, ImageClient.connect(port=port) as stream:
        with pytest.raises(ConnectionLostError, match="closed the connection"):
            stream.get_frame()


def test_receive_when_the_frame_is_too_large_refuses() -> None:
    header = encode_frame_header(ImageType.RAW, MAX_IMAGE_PAYLOAD_BYTES + 1)
    with serve_script(frame_script(header)) as port, ImageClient.connect(port=port) as stream:
        with pytest.raises(RemoteProtocolError, match="more than"):
            stream.get_frame()


def test_connect_when_nobody_listens_tells_what_to_do() -> None:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))  # bound, not listening: refused
        with pytest.raises(ConnectionLostError, match="--image-port"):
            ImageClient.connect(port=bound.getsockname()[1])
