"""Files that are read at start, and the precedence of their options for the server."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.server_file import resolve_settings
from catoptra_server.config.startup import StartupConfig, create_ray_caster, read_startup_config
from catoptra_server.runtime.memory import MIB
from catoptra_server.simulation.robot_description import RobotDescription, SensorDescription
from catoptra_server.world.scene_mesh import build_scene
from helpers.configs import write_small_world
from helpers.robots import SCANNER, make_p2at, make_walled_world
from helpers.server_process import write_small_robot


def add_image_server(robot: Path, *lines: str) -> Path:
    """Add lines of the image server to a robot's file."""
    section = "\n".join(("", "[USARBotAPI.UPISImageServer]", *lines))
    robot.write_text(robot.read_text(encoding="utf-8") + section, encoding="utf-8")
    return robot


def test_startup_with_an_unknown_key_of_our_section_is_an_error_with_its_line(
    tmp_path: Path,
) -> None:
    world = write_small_world(tmp_path, "Bakground=(R=1)")
    expected = re.escape(
        f"{world}:3: Catoptra.World.Bakground='(R=1)': expected a known key; "
        "did you mean Background?"
    )
    with pytest.raises(ConfigError, match=expected):
        read_startup_config([write_small_robot(tmp_path)], world)


def test_startup_with_an_unknown_key_of_another_section_warns_or_is_strict(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    robot, world = write_small_robot(tmp_path), write_small_world(tmp_path)
    robot.write_text(robot.read_text().replace("Mass=", "bDebug=true\nMass="))
    with caplog.at_level(logging.WARNING):
        read_startup_config([robot], world)
    assert "key bDebug is unknown and has no effect" in caplog.text
    with pytest.raises(ConfigError, match="bDebug"):
        read_startup_config([robot], world, is_strict=True)


def test_startup_with_a_broken_file_raises(tmp_path: Path) -> None:
    with pytest.raises(ConfigError):
        read_startup_config([write_small_robot(tmp_path)], write_small_world(tmp_path, "Boxes=1"))


def test_startup_with_server_options_in_two_files_prefers_the_server_s_own(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    robot = add_image_server(
        write_small_robot(tmp_path), "FrameSkip=3", "ListenPort=7", "Colours=256"
    )
    server = tmp_path / "server.ini"
    server.write_text("[USARBotAPI.UPISImageServer]\nListenPort=8\n")
    with caplog.at_level(logging.WARNING):
        settings = resolve_settings(
            read_startup_config([robot], write_small_world(tmp_path), server).server_options
        )
    assert (settings.image_port, settings.frame_skip, settings.control_port) == (8, 3, 3000)
    assert caplog.text.count("key Colours is unknown") == 1


def test_startup_with_a_server_file_without_such_sections_warns(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    server = tmp_path / "server.ini"
    server.write_text("[USARBot.P2AT]\nMass=1\n")
    with caplog.at_level(logging.WARNING):
        assert (
            read_startup_config(
                [write_small_robot(tmp_path)], write_small_world(tmp_path), server
            ).server_options
            == {}
        )
    assert f"{server} has no settings of the server" in caplog.text


def make_startup(robot: RobotDescription) -> StartupConfig:
    world = make_walled_world()
    return StartupConfig((robot,), world, build_scene(world))


@pytest.mark.parametrize("sensors", [(), (SCANNER,)])
def test_ray_caster_casts_rays_with_and_without_range_sensors(
    sensors: tuple[SensorDescription, ...],
) -> None:
    caster = create_ray_caster(make_startup(make_p2at(sensors=sensors)))
    origins, ahead = np.array([[0.0, 0.0, -0.5]]), np.array([[1.0, 0.0, 0.0]])
    assert caster.distances(origins, ahead) == pytest.approx([50.0])
    distances, normals = caster.closest_hits(origins, ahead)
    assert distances == pytest.approx([50.0])
    assert abs(normals) == pytest.approx(ahead)


def test_startup_with_a_scene_beyond_the_memory_limit_raises(tmp_path: Path) -> None:
    band = "SphereBands=(Radius=1,From=0,To=90,Sectors=512,Rings=512)"
    world = write_small_world(tmp_path, band)
    with pytest.raises(ConfigError, match=r"SphereBands1='524288 triangles'.*limit of 200 "):
        read_startup_config([write_small_robot(tmp_path)], world, limit_bytes=200 * MIB)


def test_second_robot_of_a_class_is_left_out_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    robots = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        robots.append(write_small_robot(tmp_path / name))
    with caplog.at_level(logging.WARNING):
        startup = read_startup_config(robots, write_small_world(tmp_path))
    assert [robot.class_name for robot in startup.robots] == ["USARBot.OmniP2AT"]
    assert "a second robot of class" in caplog.text


@pytest.mark.parametrize(("words", "is_occluded"), [((), True), (("AmbientOcclusion=off",), False)])
def test_world_has_ambient_occlusion_unless_it_says_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], is_occluded: bool
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    box = "Boxes=(Position=(X=0,Y=0,Z=-0.2),Size=(X=0.4,Y=0.4,Z=0.4))"
    floor = "Rectangles=(Size=(X=4,Y=4))"
    world = write_small_world(tmp_path, box, floor, "Lights=(Type=Hemisphere)", *words)
    startup = read_startup_config([write_small_robot(tmp_path)], world)
    assert (startup.scene.occlusion is not None) == is_occluded
    assert (tmp_path / "cache" / "catoptra" / "occlusion").exists() == is_occluded


def test_cameras_name_what_the_light_of_the_world_adds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    robot = write_small_robot(tmp_path)
    for words, expected in (((), ["SelfView"]), (("LightBake=on",), ["SelfView", "BakedLight"])):
        world = write_small_world(tmp_path, "Rectangles=(Size=(X=4,Y=4))", *words)
        (settings,) = read_startup_config([robot], world).effect_settings
        assert [one.effect.name for one in settings.settings] == expected
