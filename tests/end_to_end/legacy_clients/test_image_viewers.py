"""Viewers of the image port: m-shimizu's two, the Qt client, and ncamous's AR.Drone client.

All view one robot at rest, in an image of four tiles of 320 x 240 px in a row. The red wall is on
the robot's left, and so on the right of the mirrored image; the blue wall is opposite.
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


def start_wide_server(folder: Path, room: Path, *arguments: str):
    """Start a server with a camera as wide as four tiles in a row."""
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
    """Server with one image type and one spawned robot."""
    image_type, _, legacy = request.param.partition(" ")
    arguments = ["--image-type", image_type, *(["--legacy-images"] if legacy else [])]
    folder = tmp_path_factory.mktemp("wide")
    with (
        start_wide_server(folder, room, *arguments) as running,
        LineSocket(running.control_port, size=4096) as wire,
    ):
        wire.send("INIT {ClassName USARBot.OmniP2AT} {Start Robot1}\r\n")
        wire.read_line_starting_with("STA")
        yield running


def with_servers(*kinds: str) -> pytest.MarkDecorator:
    """Run a test with servers of these kinds only."""
    return pytest.mark.parametrize("wide_image_server", kinds, indirect=True)


class UsarImage2Ros:
    """usarimage2ros.py: OK and a line end, and then its buffer must hold exactly one frame."""

    def __init__(self, port: int) -> None:
        self.connection = connect(port)

    def read_frame(self) -> bytes:
        """Payload of one frame; further bytes fail the test."""
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
        """Image of a camera's tile."""
        tile = (number * TILE % WIDTH, number // 4 * HEIGHT, TILE, HEIGHT)
        self.connection.sendall(struct.pack(">I4I", ord("U"), *tile))
        kind, length = struct.unpack(">BI", receive_exactly(self.connection, 5))
        assert kind == 0, "the client reads no JPEG"
        payload = receive_exactly(self.connection, length)
        width, height = struct.unpack_from(">HH", payload)
        rows = np.frombuffer(payload, np.uint8, height * width * 3, offset=4)
        return rows.reshape(height, width, 3)[:, :, ::-1]


class ArDroneClient:
    """Legacy mode; the bytes from the ninth on are a BGR image without padding."""

    def __init__(self, port: int) -> None:
        self.connection = connect(port)

    def read_frame(self) -> Pixels:
        """Read a frame, and request the next."""
        head = receive_exactly(self.connection, 9)
        assert head[0] == 0, "the client reads no JPEG"
        width, height = struct.unpack_from(">HH", head, 5)
        rest = receive_exactly(self.connection, int.from_bytes(head[1:5], "big") - 4)
        self.connection.sendall(b"OK")
        return np.frombuffer(rest, np.uint8).reshape(height, width, 3)[:, :, ::-1]


def cut_four_tiles(port: int) -> list[Pixels]:
    """Four crops of a whole JPEG, as m-shimizu's viewer shows them; the viewer ignores RAW."""
    with connect(port) as connection:
        connection.sendall(b"OK")
        header = receive_exactly(connection, 5)
        assert header[0] != 0, "the viewer ignores RAW"
        rgb = rgb_from_image_bytes(receive_exactly(connection, int.from_bytes(header[1:], "big")))
    return [rgb[:HEIGHT, n * TILE : (n + 1) * TILE] for n in range(4)]


def assert_shows_walls(rgb: Pixels) -> None:
    """Assert that red is in the right half of the image, and blue in the left."""
    left, right = (half.astype(int) for half in np.split(rgb, 2, axis=1))
    for half, channel, other in ((right, 0, 2), (left, 2, 0)):
        assert np.count_nonzero(half[..., channel] - half[..., other] > 150) > 500
        assert not np.any(half[..., other] - half[..., channel] > 150)


@with_servers("RAW", "GOOD")
def test_usarimage2ros_when_it_requests_first_receives_one_frame_at_a_time(
    wide_image_server: RunningServer,
) -> None:
    viewer = UsarImage2Ros(wide_image_server.image_port)
    with viewer.connection:
        sizes = [len(viewer.read_frame()) for _ in range(10)]
    assert min(sizes) > 0


@with_servers("RAW")
def test_qt_client_when_it_requests_tiles_receives_crops_of_the_image(
    wide_image_server: RunningServer,
) -> None:
    qt, whole = QtClient(wide_image_server.image_port), wide_image_server.connect_images()
    with qt.connection, whole:
        tiles = np.concatenate([qt.read_tile(number) for number in range(4)], axis=1)
        assert_shows_walls(tiles)
        # Equal bytes: the robot is at rest, and the rays of a pixel are the same in each frame.
        assert np.array_equal(tiles, whole.get_frame().rgb)


@with_servers("RAW")
def test_qt_client_when_a_tile_is_absent_still_receives_an_image(
    wide_image_server: RunningServer,
) -> None:
    qt = QtClient(wide_image_server.image_port)
    with qt.connection:
        assert qt.read_tile(4).size > 0
        assert qt.read_tile(3).shape == (HEIGHT, TILE, 3)


@with_servers("GOOD")
def test_four_crops_of_a_jpeg_are_complete(wide_image_server: RunningServer) -> None:
    crops = cut_four_tiles(wide_image_server.image_port)
    assert {crop.shape for crop in crops} == {(HEIGHT, TILE, 3)}
    assert_shows_walls(np.concatenate(crops, axis=1))


@with_servers("RAW legacy")
def test_ar_drone_client_when_the_first_frame_is_sent_without_request_reads_its_colours(
    wide_image_server: RunningServer,
) -> None:
    viewer = ArDroneClient(wide_image_server.image_port)
    with viewer.connection:
        frames = [viewer.read_frame() for _ in range(5)]
    assert {frame.shape for frame in frames} == {(HEIGHT, WIDTH, 3)}
    assert_shows_walls(frames[-1])
