from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms
from catoptra_server.render.raster.scene_buffers import MAX_POINT_LIGHTS, SceneBuffers
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.worlds import (
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_test_world,
    translate_world,
    write_smooth_texture,
)


def build_programs(device: GlDevice, world: World) -> tuple[str, ...]:
    programs = ShaderPrograms(device.context)
    SceneBuffers(device.context, programs, build_scene(world), world).close()
    return programs.names


def test_plain_world_builds_the_plain_program_only(device: GlDevice) -> None:
    assert build_programs(device, make_test_world()) == ("face",)


def test_texture_adds_one_program_for_its_batch(device: GlDevice, tmp_path: Path) -> None:
    world = make_test_world(texture=write_smooth_texture(tmp_path / "waves.png"))
    assert build_programs(device, world) == ("face", "face TEXTURED=1")


def test_point_light_changes_every_program(device: GlDevice, tmp_path: Path) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, POINT_LIGHT), texture=write_smooth_texture(tmp_path / "waves.png")
    )
    built = build_programs(device, world)
    assert built == ("face NUM_POINT_LIGHTS=1", "face TEXTURED=1 NUM_POINT_LIGHTS=1")


def test_empty_world_builds_nothing(device: GlDevice) -> None:
    assert build_programs(device, World("empty", ())) == ()


def test_too_many_point_lights_are_rejected(device: GlDevice) -> None:
    world = make_test_world(lights=(POINT_LIGHT,) * (MAX_POINT_LIGHTS + 1))
    with pytest.raises(DomainError, match="at most 100 point lights"):
        build_programs(device, world)


def test_largest_number_of_point_lights_compiles(device: GlDevice) -> None:
    assert build_programs(device, make_test_world(lights=(POINT_LIGHT,) * MAX_POINT_LIGHTS)) == (
        "face NUM_POINT_LIGHTS=100",
    )


def test_origin_is_the_centre_of_the_scene(device: GlDevice) -> None:
    world = translate_world(make_test_world(), (1e4, 0.0, -20.0))
    scene = build_scene(world)
    buffers = SceneBuffers(device.context, ShaderPrograms(device.context), scene, world)
    centre = 0.5 * (scene.corners.min((0, 1)) + scene.corners.max((0, 1)))
    assert np.array_equal(buffers.origin, centre)
    buffers.close()
