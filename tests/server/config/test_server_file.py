"""UDK's sections of the server itself; cameras at the sizes of tiles and viewports."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.server_file import (
    ServerOptions,
    ServerSettings,
    read_server_options,
    require_tiles_fit,
    resolve_settings,
)
from catoptra_server.frames.multi_view import multi_view_layout
from helpers.configs import OMNI_ROBOT, ROBOTS, Edit, write_edited_copy

# As they stand in UDK's DefaultUSAR.ini.
UDK = """[USARBotAPI.BotServer]
ListenPort=3000
MaxConnections=64

[USARBotAPI.UPISImageServer]
bEnableImageServer=true
ListenPort=5003
FrameSkip=1
ImageType=0
LegacyMode=false

[USARBotAPI.MultiView]
CameraTileX=2
CameraTileY=2
CameraWidth=320
CameraHeight=240
"""


def write_file(folder: Path, text: str) -> IniFile:
    path = folder / "server.ini"
    path.write_text(text, encoding="utf-8")
    return IniFile(path)


def test_options_when_of_udk_s_own_sections_are_complete(tmp_path: Path) -> None:
    file = write_file(tmp_path, UDK)
    assert read_server_options(file) == ServerOptions(
        control_port=3000,
        max_connections=64,
        has_images=True,
        image_port=5003,
        frame_skip=1,
        image_type=ImageType.RAW,
        legacy_images=False,
        multi_view=multi_view_layout(2, 2, width_px=320, height_px=240),
    )
    assert not file.unknown_names()


def test_limits_of_connections_are_read(tmp_path: Path) -> None:
    text = (
        "[USARBotAPI.BotServer]\nMaxConnections=8\nHandshakeTimeout=60\nIdleTimeout=0\n"
        "[USARBotAPI.UPISImageServer]\nMaxConnections=16\n"
    )
    file = write_file(tmp_path, text)
    settings = resolve_settings(read_server_options(file))
    assert (settings.max_connections, settings.max_image_connections) == (8, 16)
    assert (settings.handshake_timeout_s, settings.idle_timeout_s) == (60.0, 0.0)
    assert not file.unknown_names()


def test_options_when_a_file_has_no_such_section_are_empty(tmp_path: Path) -> None:
    assert read_server_options(write_file(tmp_path, "[USARBot.P2AT]\n")) == ServerOptions()


@pytest.mark.parametrize(
    ("text", "expected"),
    [("fair", ImageType.FAIR), ("SUPER", ImageType.SUPER), ("5", ImageType.BAD),
     ("", ImageType.NORMAL)],
)  # fmt: skip
def test_image_type_when_a_tag_a_number_or_empty_is_read(
    tmp_path: Path, text: str, expected: ImageType
) -> None:
    file = write_file(tmp_path, f"[USARBotAPI.UPISImageServer]\nImageType={text}\n")
    assert read_server_options(file) == ServerOptions(image_type=expected)


@pytest.mark.parametrize(
    ("section", "line", "expected"),
    [
        ("BotServer", "ListenPort=65536", "a whole number from 0 to 65535"),
        ("BotServer", "ListenPort=", "a whole number"),
        ("BotServer", "MaxConnections=0", "a whole number from 1 to 4096"),
        ("BotServer", "HandshakeTimeout=-1", "from 0"),
        ("BotServer", "IdleTimeout=600000", "to 86400"),
        ("UPISImageServer", "MaxConnections=5000", "a whole number from 1 to 4096"),
        ("UPISImageServer", "FrameSkip=0", "a whole number from 1"),
        ("UPISImageServer", "ImageType=PNG", "RAW, SUPER, GOOD"),
        ("UPISImageServer", "LegacyMode=perhaps", "true or false"),
        ("UPISImageServer", "bEnableImageServer=2", "true or false"),
        ("MultiView", "CameraTileX=0", "a whole number from 1"),
        ("MultiView", "CameraTileX=300", "smaller or fewer tiles: an image of 96000 x 480 px"),
    ],
)
def test_value_when_impossible_is_rejected_with_file_line_and_key(
    tmp_path: Path, section: str, line: str, expected: str
) -> None:
    file = write_file(tmp_path, f"[USARBotAPI.{section}]\n{line}\n")
    with pytest.raises(ConfigError, match=re.escape(expected)) as error:
        read_server_options(file)
    assert str(error.value).startswith(f"{tmp_path / 'server.ini'}:2: ")
    assert line.partition("=")[0] in str(error.value)


@pytest.mark.parametrize("section", ["BotServer", "UPISImageServer", "MultiView"])
def test_key_when_unknown_is_reported_also_as_the_only_one(tmp_path: Path, section: str) -> None:
    file = write_file(tmp_path, f"[USARBotAPI.{section}]\nListenPorts=1\n")
    read_server_options(file)
    assert [entry.key for entry in file.unknown_names()] == ["ListenPorts"]


def test_tiles_when_partly_stated_are_udk_s_for_the_rest(tmp_path: Path) -> None:
    file = write_file(tmp_path, "[USARBotAPI.MultiView]\nCameraTileX=4\nCameraTileY=1\n")
    assert read_server_options(file) == ServerOptions(
        multi_view=multi_view_layout(4, 1, width_px=320, height_px=240)
    )


def test_settings_without_any_option_are_the_defaults() -> None:
    assert resolve_settings(ServerOptions(), ServerOptions()) == ServerSettings()


def test_settings_when_stated_twice_are_those_of_the_last_layer() -> None:
    first, last = ServerOptions(image_port=1, frame_skip=2), ServerOptions(image_port=3)
    assert resolve_settings(first, last) == ServerSettings(image_port=3, frame_skip=2)


MANY_SAMPLES = Edit("Samples=2 ", "Samples=16 ")


@pytest.mark.parametrize("path", sorted(ROBOTS.glob("*.ini")), ids=lambda path: path.name)
def test_bundled_robot_fits_its_viewports_and_the_usual_tiles(path: Path) -> None:
    robots, _ = read_robots(path)
    require_tiles_fit(robots, None)
    require_tiles_fit(robots, multi_view_layout(2, 2, width_px=640, height_px=480))


@pytest.mark.parametrize(("width_px", "height_px"), [(2000, 2000), (200, 20000), (20000, 200)])
def test_camera_when_too_large_for_its_tile_is_rejected(
    tmp_path: Path, width_px: int, height_px: int
) -> None:
    robots, _ = read_robots(write_edited_copy(OMNI_ROBOT, tmp_path, MANY_SAMPLES))
    layout = multi_view_layout(1, 1, width_px=width_px, height_px=height_px)
    tile = f"a tile of {width_px} x {height_px} px"
    expected = rf"OmniP2AT: OmniCamPillar_Link4='{tile}'.*smaller tiles.* MiB"
    with pytest.raises(ConfigError, match=expected):
        require_tiles_fit(robots, layout)
    require_tiles_fit(robots, layout, limit_bytes=2**36)


def test_camera_when_too_large_for_a_viewport_of_a_larger_camera_is_rejected(
    tmp_path: Path,
) -> None:
    wide = (
        "Cameras=(ItemClass=class'USARBot.RobotCamera',ItemName=\"Wide\",Position=(X=0,Y=0,Z=0),"
        "Direction=(X=0,Y=0,Z=0))"
    )
    path = write_edited_copy(OMNI_ROBOT, tmp_path, MANY_SAMPLES)
    robot = path.read_text(encoding="utf-8").replace(
        "[USARBot.OmniP2AT]", f"[USARBot.OmniP2AT]\n{wide}"
    )
    robot += "\n[USARBot.RobotCamera]\nResolutionX=2400\nResolutionY=2400\n"
    path.write_text(robot, encoding="utf-8")
    robots, _ = read_robots(path)
    assert robots[0].perspective_cameras[0].width_px == 2400
    with pytest.raises(ConfigError, match="a tile of 1200 x 1200 px"):
        require_tiles_fit(robots, None)
