"""Several cameras in one image of the image port: UDK's tiles, UT2004's viewports.

One robot in the room with the red wall on its left and the blue wall on its right. Its cameras are
the omnidirectional one, and three perspective ones that look ahead, to the left and to the right.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.frame import Pixels
from end_to_end.legacy_clients.test_image_viewers import HEIGHT, TILE, QtClient, cut_four_tiles
from helpers.control_lines import ControlLines, connect_control_lines
from helpers.server_process import RunningServer, start_server, write_small_robot

TILES = "4x1:320x240"
INIT = "INIT {ClassName USARBot.OmniP2AT} {Start Robot1}"
CAMERA = (
    "Cameras=(ItemClass=class'USARBot.RobotCamera',ItemName=\"{}\","
    "Position=(X=0.0,Y=0.0,Z=-0.8),Direction=(X=0.0,Y=0.0,Z={}))\n"
)
PERSPECTIVE_YAWS_RAD = {"Ahead": 0.0, "Left": -1.5708, "Right": 1.5708}


@contextmanager
def start_stepped_server(
    folder: Path, room: Path, *arguments: str, is_awaited: bool = True
) -> Iterator[tuple[RunningServer, ControlLines]]:
    """Serve the room under lockstep; yield the server and the connection of its one robot.

    Args:
        folder: A folder for the robot's file.
        room: The world.
        arguments: Further arguments of the server.
        is_awaited: Whether the spawn's reply has been read.
    """
    robot = write_small_robot(folder)
    cameras = "".join(
        CAMERA.format(name, yaw_rad) for name, yaw_rad in PERSPECTIVE_YAWS_RAD.items()
    )
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text.replace("Cameras=(", f"{cameras}Cameras=(", 1), encoding="utf-8")
    with (
        start_server(folder, "--clock", "lockstep", *arguments, robot=robot, world=room) as server,
        connect_control_lines(server.control_port) as lines,
    ):
        lines.send(INIT)
        if is_awaited:
            lines.read_until("STA")
        yield server, lines
        assert server.terminate() == 0
        assert "Traceback" not in server.log.read_text()


def colour_fraction(rgb: Pixels, channel: int) -> float:
    """Fraction of pixels that are red (channel 0) or blue (2)."""
    levels = rgb.astype(int)
    return float(np.mean(levels[..., channel] - levels[..., 2 - channel] > 150))


def assert_tiles_show_walls(tiles: list[Pixels]) -> None:
    """Assert that the tiles are those of the mirror, ahead, left and right."""
    mirror, ahead, left, right = (
        [colour_fraction(tile, 0), colour_fraction(tile, 2)] for tile in tiles
    )
    assert min(mirror) > 0.01
    assert max(ahead) < 0.2
    assert left[0] > 0.3
    assert left[1] == 0.0
    assert right[1] > 0.3
    assert right[0] == 0.0


def test_qt_client_when_it_requests_tiles_receives_a_camera_in_each(
    tmp_path: Path, room: Path
) -> None:
    options = ("--multi-view", TILES, "--image-type", "RAW")
    with start_stepped_server(tmp_path, room, *options) as (server, _):
        qt = QtClient(server.image_port)
        with qt.connection, server.connect_images() as whole:
            tiles = [qt.read_tile(number) for number in range(4)]
            assert_tiles_show_walls(tiles)
            assert np.array_equal(np.concatenate(tiles, axis=1), whole.get_frame().rgb)


def test_qt_client_when_it_requests_one_tile_has_no_other_rendered(
    tmp_path: Path, room: Path
) -> None:
    options = ("--multi-view", TILES, "--image-type", "RAW")
    with start_stepped_server(tmp_path, room, *options) as (server, _):
        qt, mirror_plan = QtClient(server.image_port), f"plan of {TILE} x {HEIGHT} px"
        with qt.connection:
            assert colour_fraction(qt.read_tile(2), 0) > 0.3
            assert mirror_plan not in server.log.read_text()
            qt.read_tile(0)
            assert mirror_plan in server.log.read_text()


def test_four_crops_of_a_multi_view_are_its_cameras(tmp_path: Path, room: Path) -> None:
    with start_stepped_server(tmp_path, room, "--multi-view", TILES) as (server, _):
        crops = cut_four_tiles(server.image_port)
        assert {crop.shape for crop in crops} == {(HEIGHT, TILE, 3)}
        assert_tiles_show_walls(crops)


def test_configuration_of_a_camera_with_a_tile_is_sent_without_request_in_udk(
    tmp_path: Path, room: Path
) -> None:
    options = ("--multi-view", TILES, "--dialect", "udk")
    with start_stepped_server(tmp_path, room, *options, is_awaited=False) as (_, lines):
        configurations = [lines.read_until("CONF")[-1] for _ in range(4)]
    offsets = [
        re.search(r"\{TextureOffsetX (\d+)\}\{TextureOffsetY (\d+)\}", line)
        for line in configurations
    ]
    assert [match and match.groups() for match in offsets] == [
        (str(number * TILE), "0") for number in range(4)
    ]
    assert "{Name Ahead}" in configurations[1]
    assert "{TextureResolutionX 320}{TextureResolutionY 240}" in configurations[1]


def test_status_when_cameras_have_tiles_names_the_first_in_ut2004(
    tmp_path: Path, room: Path
) -> None:
    options = ("--multi-view", TILES)
    with start_stepped_server(tmp_path, room, *options, is_awaited=False) as (server, lines):
        assert "{View 0}" in lines.read_until("STA")[-1]
        with connect_control_lines(server.control_port) as second:
            second.send(INIT)
            # All four tiles are the first robot's.
            assert "{View -1}" in second.read_until("STA")[-1]


@pytest.mark.parametrize(("name", "channel"), [("Left", 0), ("Right", 2)])
def test_viewport_when_set_shows_that_camera(
    tmp_path: Path, room: Path, name: str, channel: int
) -> None:
    with start_stepped_server(tmp_path, room) as (server, lines), server.connect_images() as images:
        assert images.get_frame().rgb.shape == (64, 64, 3)  # the omnidirectional camera's
        lines.send(f"SET {{Type Viewports}} {{Config SingleView}} {{Viewport1 {name}}}")
        assert f"{{Viewport1 {name}}} {{Status OK}}" in lines.read_until("RES")[-1]
        rgb = images.get_frame().rgb
        assert rgb.shape == (240, 320, 3)
        assert colour_fraction(rgb, channel) > 0.3
        assert colour_fraction(rgb, 2 - channel) == 0.0


def test_viewports_when_four_are_quarters_of_the_image(tmp_path: Path, room: Path) -> None:
    with start_stepped_server(tmp_path, room) as (server, lines), server.connect_images() as images:
        lines.send(
            "SET {Type Viewports} {Config QuadView} {Viewport1 Left} {Viewport2 Right} "
            "{Viewport3 Disable} {Viewport4 OmniCamPillar_Link4}"
        )
        lines.read_until("RES")
        rgb = images.get_frame().rgb
    assert rgb.shape == (64, 64, 3)
    first, second, third, fourth = rgb[:32, :32], rgb[:32, 32:], rgb[32:, :32], rgb[32:, 32:]
    assert colour_fraction(first, 0) > 0.2
    assert colour_fraction(second, 2) > 0.2
    assert third.max() < 20  # black, but for the ringing of JPEG blocks
    assert fourth.any()


def test_camera_when_zoomed_shows_a_narrower_view(tmp_path: Path, room: Path) -> None:
    with start_stepped_server(tmp_path, room) as (server, lines), server.connect_images() as images:
        lines.send("SET {Type Viewports} {Config SingleView} {Viewport1 Left}")
        lines.read_until("RES")
        before = colour_fraction(images.get_frame().rgb, 0)
        lines.send("SET {Type Camera} {Name Left} {FOV 0.4}")
        assert lines.read_until("RES")[-1].endswith("{Name Left} {FOV 0.4000} {Status OK}")
        after = colour_fraction(images.get_frame().rgb, 0)
    # The wall reaches 1 m above and 0.8 m below the line of sight, 2 m away.
    assert before < 0.95
    assert after > 0.99


def test_image_port_when_frames_are_skipped_exposes_at_that_interval(
    tmp_path: Path, room: Path
) -> None:
    with start_server(tmp_path, "--frame-skip", "20", world=room) as server:
        with server.connect_stream() as client:
            client.spawn("USARBot.OmniP2AT", name="R", start_pose="Robot1")
            times_s = [client.get_frame().time_s or 0.0 for _ in range(5)]
    assert min(np.diff(times_s[1:])) >= 0.4 - 1e-9
