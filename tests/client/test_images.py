"""The image client against a scripted server."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from catoptra_client.images import ImageStream, Pixels, rgb_from_wire
from catoptra_protocol.errors import ConnectionLostError, RemoteProtocolError
from catoptra_protocol.wire.image import (
    ImageType,
    WholeFrame,
    WireFrame,
    frame_header,
    raw_header,
    raw_pitch,
)
from catoptra_protocol.wire.limits import MAX_IMAGE_PAYLOAD_BYTES
from client.scripted_server import ImageScript, serving, wait_for_close

SHORT_S = 0.05  # a timeout that is meant to pass


def flat(value: int, width: int = 6, height: int = 4) -> Pixels:
    """Return a picture of (value, 20, 240) everywhere: red tells the frame, blue is high."""
    return np.full((height, width, 3), (value, 20, 240), np.uint8)


def raw_payload(rgb: Pixels, pitch: int | None = None) -> bytes:
    """Return the RAW payload of a picture, rows padded to the pitch."""
    height, width, _ = rgb.shape
    padding = bytes((raw_pitch(width) if pitch is None else pitch) - 3 * width)
    return raw_header(width, height) + b"".join(row[:, ::-1].tobytes() + padding for row in rgb)


def raw_frame(value: int) -> bytes:
    payload = raw_payload(flat(value))
    return frame_header(ImageType.RAW, len(payload)) + payload


def answering(*frames: bytes, unasked: bytes = b"") -> Callable[[socket.socket], None]:
    """Return a script that answers each request with the next frame."""

    def script(connection: socket.socket) -> None:
        images = ImageScript(connection)
        images.send(unasked)
        for frame in frames:
            assert images.next_request() == WholeFrame()
            images.send(frame)
        wait_for_close(connection)

    return script


def red(frame_rgb: Pixels) -> int:
    return int(frame_rgb[0, 0, 0])


@pytest.mark.parametrize("pitch", [20, 18])
def test_rgb_when_raw_and_rows_padded_or_not_is_the_picture(pitch: int) -> None:
    picture = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    rgb = rgb_from_wire(WireFrame(ImageType.RAW, raw_payload(picture, pitch)))
    assert np.array_equal(rgb, picture)
    assert not rgb.flags.writeable
    assert rgb.flags.c_contiguous


def test_rgb_when_jpeg_has_red_first() -> None:
    picture = flat(200, 32, 16)
    encoded, payload = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])
    assert encoded
    rgb = rgb_from_wire(WireFrame(ImageType.SUPER, payload.tobytes()))
    assert rgb.shape == (16, 32, 3)
    # Quality 100 still rounds in YCbCr: three levels.
    assert np.abs(rgb.astype(int) - picture).max() <= 3
    assert not rgb.flags.writeable


@pytest.mark.parametrize("image_type", [ImageType.RAW, ImageType.GOOD])
def test_rgb_when_the_payload_is_empty_is_an_empty_picture(image_type: ImageType) -> None:
    assert rgb_from_wire(WireFrame(image_type, b"")).shape == (0, 0, 3)


def test_rgb_when_raw_has_no_pixels_is_an_empty_picture() -> None:
    assert rgb_from_wire(WireFrame(ImageType.RAW, raw_header(0, 0))).size == 0


BAD = [
    (ImageType.RAW, raw_header(6, 4) + bytes(5), "RAW frame"),
    (ImageType.GOOD, b"no jpeg at all", "no JPEG"),
    (ImageType.GOOD, b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03", "we accept"),
    (ImageType.GOOD, b"\xff\xd8\xff\xc0\0\x11\x08\0\x10\0\x10\x03", "cannot be decoded"),
]


@pytest.mark.parametrize(("image_type", "payload", "said"), BAD)
def test_rgb_when_the_payload_is_no_picture_refuses(
    image_type: ImageType, payload: bytes, said: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=said):
        rgb_from_wire(WireFrame(image_type, payload))


def test_frame_when_asked_for_is_counted_and_timed() -> None:
    with (
        serving(answering(raw_frame(1), raw_frame(2))) as port,
        socket.create_connection(("127.0.0.1", port)) as connection,
    ):
        stream = ImageStream(connection, clock=lambda: 42.0)
        frames = [stream.frame(), stream.frame()]
    assert [(red(f.rgb), f.sequence) for f in frames] == [(1, 0), (2, 1)]
    assert {(f.received_s, f.image_type) for f in frames} == {(42.0, ImageType.RAW)}


def test_frames_when_iterated_keep_one_request_ahead() -> None:
    def script(connection: socket.socket) -> None:
        images = ImageScript(connection)
        images.next_request()
        for value in range(3):
            images.next_request()  # the next request is there before this frame is sent
            images.send(raw_frame(value))
        wait_for_close(connection)

    with serving(script) as port, ImageStream.connect(port=port) as stream:
        frames = list(itertools.islice(stream.frames(), 3))
    assert [red(frame.rgb) for frame in frames] == [0, 1, 2]


def test_frame_when_frames_were_left_early_passes_over_those_owed() -> None:
    with serving(answering(*map(raw_frame, range(4)))) as port:
        with ImageStream.connect(port=port) as stream:
            first = next(iter(stream.frames()))  # asks for two
            fresh = stream.frame()  # asks for the third
            last = stream.frame()
    assert [red(f.rgb) for f in (first, fresh, last)] == [0, 2, 3]


def test_receive_when_the_server_is_in_legacy_mode_takes_the_frame_unasked() -> None:
    with serving(answering(raw_frame(1), unasked=raw_frame(0))) as port:
        with ImageStream.connect(port=port) as stream:
            assert red(stream.receive().rgb) == 0
            assert red(stream.frame().rgb) == 1


def test_receive_when_a_frame_is_cut_into_pieces_puts_it_together() -> None:
    def script(connection: socket.socket) -> None:
        images = ImageScript(connection)
        images.next_request()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in raw_frame(7):
            images.send(bytes([byte]))
        wait_for_close(connection)

    with serving(script) as port, ImageStream.connect(port=port) as stream:
        assert np.array_equal(stream.frame().rgb, flat(7))


def test_receive_when_a_picture_is_large_is_whole() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (640, 640, 3), np.uint8)
    payload = raw_payload(picture)
    data = frame_header(ImageType.RAW, len(payload)) + payload
    with serving(answering(data, data)) as port, ImageStream.connect(port=port) as stream:
        assert np.array_equal(stream.frame().rgb, picture)
        assert np.array_equal(stream.frame().rgb, picture)


def test_receive_when_no_frame_comes_asks_what_may_be_wrong() -> None:
    with (
        serving(wait_for_close) as port,
        ImageStream.connect(port=port, timeout_s=SHORT_S) as stream,
        pytest.raises(ConnectionLostError, match="is this the image port"),
    ):
        stream.frame()


def test_receive_when_the_server_vanishes_mid_frame_tells_so() -> None:
    def script(connection: socket.socket) -> None:
        ImageScript(connection).next_request()
        connection.sendall(raw_frame(1)[:-1])

    with serving(script) as port, ImageStream.connect(port=port) as stream:
        with pytest.raises(ConnectionLostError, match="closed the connection"):
            stream.frame()


def test_receive_when_the_frame_is_too_large_refuses() -> None:
    header = frame_header(ImageType.RAW, MAX_IMAGE_PAYLOAD_BYTES + 1)
    with serving(answering(header)) as port, ImageStream.connect(port=port) as stream:
        with pytest.raises(RemoteProtocolError, match="more than"):
            stream.frame()


def test_connect_when_nobody_listens_tells_what_to_do() -> None:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))  # bound, not listening: refused
        with pytest.raises(ConnectionLostError, match="--image-port"):
            ImageStream.connect(port=bound.getsockname()[1])
