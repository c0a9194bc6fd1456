"""Viewers of the image port: m-shimizu's two, the Qt client, and ncamous's AR.Drone client.

All see one robot that stands still, through a picture of four tiles of 320 x 240 px in a row. The
red wall is on its left, so on the right of the mirrored picture; the blue one the other way round.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.frame import Pixels, rgb_from_image_bytes
from helpers.configs import OMNI_ROBOT, Edit, write_edited_copy
from helpers.legacy_sockets import LineSocket, connect, receive, receive_exactly
from helpers.server_process import RunningServer, start_server

WIDTH, HEIGHT, TILE = 1280, 240, 320


def wide_server(folder: Path, room: Path, *arguments: str):
    """Return a server whose robot has a picture of four tiles in a row."""
    sizes = (
        Edit("ResolutionX=360", f"ResolutionX={WIDTH}"),
        Edit("ResolutionY=360", f"ResolutionY={HEIGHT}"),
    )
    robot = write_edited_copy(OMNI_ROBOT, folder, *sizes, Edit("Samples=2 ", "Samples=1 "))
    return start_server(folder, *arguments, robot=robot, world=room)


@pytest.fixture(scope="module", params=["RAW", "GOOD", "RAW legacy"])
def wide_image_server(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, room: Path
) -> Iterator[RunningServer]:
    """Serve pictures of one type to one robot that is there."""
    image_type, _, legacy = request.param.partition(" ")
    arguments = ["--image-type", image_type, *(["--legacy-images"] if legacy else [])]
    folder = tmp_path_factory.mktemp("wide")
    with (
        wide_server(folder, room, *arguments) as running,
        LineSocket(running.control_port, size=4096) as wire,
    ):
        wire.send("INIT {ClassName USARBot.OmniP2AT} {Start Robot1}\r\n")
        wire.read_line_starting_with("STA")
        yield running


def with_servers(*kinds: str) -> pytest.MarkDecorator:
    """Run a test with servers of these kinds only."""
    return pytest.mark.parametrize("wide", kinds, indirect=True)


class UsarImage2Ros:
    """usarimage2ros.py: OK and a line end, and then its buffer must hold exactly one frame."""

    def __init__(self, port: int) -> None:
        self.connection = connect(port)

    def read_frame(self) -> bytes:
        """Return the payload of one frame; more bytes than that are an error."""
        self.connection.sendall(b"OK\r\n")
        buffer = b""
        while len(buffer) < 5 or len(buffer) < 5 + int.from_bytes(buffer[1:5], "big"):
            buffer += receive(self.connection, 4096)
        assert len(buffer) == 5 + int.from_bytes(buffer[1:5], "big"), "more than one frame"
        return buffer[5:]


class QtClient:
    """One U for each of its tiles, its letter as a 32-bit number; stride 3 * width; swaps R and B.

    Camera n is the tile at ((n * 320) mod 1280, (n div 4) * 240).
    """

    def __init__(self, port: int) -> None:
        self.connection = connect(port)

    def read_tile(self, number: int) -> Pixels:
        """Return a camera's picture."""
        place = (number * TILE % WIDTH, number // 4 * HEIGHT, TILE, HEIGHT)
        self.connection.sendall(struct.pack(">I4I", ord("U"), *place))
        kind, length = struct.unpack(">BI", receive_exactly(self.connection, 5))
        assert kind == 0, "it reads no JPEG"
        payload = receive_exactly(self.connection, length)
        width, height = struct.unpack_from(">HH", payload)
        rows = np.frombuffer(payload, np.uint8, height * width * 3, offset=4)
        return rows.reshape(height, width, 3)[:, :, ::-1]


class ArDroneClient:
    """Legacy mode; bytes 9 and on of the frame are a BGR picture without padding."""

    def __init__(self, port: int) -> None:
        self.connection = connect(port)

    def read_frame(self) -> Pixels:
        """Return a frame, and ask for the next."""
        head = receive_exactly(self.connection, 9)
        assert head[0] == 0, "it reads no JPEG"
        width, height = struct.unpack_from(">HH", head, 5)
        rest = receive_exactly(self.connection, int.from_bytes(head[1:5], "big") - 4)
        self.connection.sendall(b"OK")
        return np.frombuffer(rest, np.uint8).reshape(height, width, 3)[:, :, ::-1]


def cut_four_tiles(port: int) -> list[Pixels]:
    """Return the four boxes that m-shimizu's viewer cuts from a whole JPEG; it ignores RAW."""
    with connect(port) as connection:
        connection.sendall(b"OK")
        header = receive_exactly(connection, 5)
        assert header[0] != 0, "it ignores RAW"
        rgb = rgb_from_image_bytes(receive_exactly(connection, int.from_bytes(header[1:], "big")))
    return [rgb[:HEIGHT, n * TILE : (n + 1) * TILE] for n in range(4)]


def assert_shows_the_walls(rgb: Pixels) -> None:
    """Fail unless red is in the right half of the picture, and blue in the left."""
    left, right = (half.astype(int) for half in np.split(rgb, 2, axis=1))
    for half, here, not_here in ((right, 0, 2), (left, 2, 0)):
        assert np.count_nonzero(half[..., here] - half[..., not_here] > 150) > 500
        assert not np.any(half[..., not_here] - half[..., here] > 150)


@with_servers("RAW", "GOOD")
def test_usarimage2ros_when_it_asks_first_finds_one_frame_in_its_buffer(
    wide: RunningServer,
) -> None:
    viewer = UsarImage2Ros(wide.image_port)
    with viewer.connection:
        sizes = [len(viewer.read_frame()) for _ in range(10)]
    assert min(sizes) > 0


@with_servers("RAW")
def test_qt_client_when_it_asks_for_tiles_gets_the_parts_of_the_picture(
    wide: RunningServer,
) -> None:
    qt, whole = QtClient(wide.image_port), wide.connect_images()
    with qt.connection, whole:
        tiles = np.concatenate([qt.read_tile(number) for number in range(4)], axis=1)
        assert_shows_the_walls(tiles)
        # The robot stands still and a pixel's rays are always the same.
        assert np.array_equal(tiles, whole.get_frame().rgb)


@with_servers("RAW")
def test_qt_client_when_a_tile_is_not_there_still_gets_a_picture(wide: RunningServer) -> None:
    qt = QtClient(wide.image_port)
    with qt.connection:
        assert qt.read_tile(4).size > 0
        assert qt.read_tile(3).shape == (HEIGHT, TILE, 3)


@with_servers("GOOD")
def test_four_boxes_when_cut_from_a_jpeg_are_whole(wide: RunningServer) -> None:
    boxes = cut_four_tiles(wide.image_port)
    assert {box.shape for box in boxes} == {(HEIGHT, TILE, 3)}
    assert_shows_the_walls(np.concatenate(boxes, axis=1))


@with_servers("RAW legacy")
def test_ar_drone_client_when_the_first_frame_comes_unasked_sees_its_colours(
    wide: RunningServer,
) -> None:
    viewer = ArDroneClient(wide.image_port)
    with viewer.connection:
        pictures = [viewer.read_frame() for _ in range(5)]
    assert {picture.shape for picture in pictures} == {(HEIGHT, WIDTH, 3)}
    assert_shows_the_walls(pictures[-1])
