"""Cameras at the sizes of tiles and viewports, in all bundled robots and in impossible ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.server_file import require_tiles_fit
from catoptra_server.frames.multi_view import multi_view_layout
from helpers.configs import OMNI_ROBOT, ROBOTS, Edit, write_edited_copy

MANY_SAMPLES = Edit("Samples=2 ", "Samples=16 ")


@pytest.mark.parametrize("path", sorted(ROBOTS.glob("*.ini")), ids=lambda path: path.name)
def test_bundled_robot_fits_its_viewports_and_the_usual_tiles(path: Path) -> None:
    robots, _ = read_robots(path)
    require_tiles_fit(robots, None)
    require_tiles_fit(robots, multi_view_layout(2, 2, width_px=640, height_px=480))


def test_camera_when_too_large_for_its_tile_is_rejected(tmp_path: Path) -> None:
    robots, _ = read_robots(write_edited_copy(OMNI_ROBOT, tmp_path, MANY_SAMPLES))
    layout = multi_view_layout(1, 1, width_px=2000, height_px=2000)
    expected = r"OmniP2AT: OmniCamPillar_Link4='a tile of 2000 x 2000 px'.*smaller tiles.* MiB"
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
