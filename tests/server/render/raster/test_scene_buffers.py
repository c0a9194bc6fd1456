"""Programs and buffers of a static scene."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms
from catoptra_server.render.raster.scene_batches import ImageTexture
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.shadows import DIM_HEMISPHERE_LIGHT, box_item, floor_item, make_world
from helpers.standing_things import pierce_scene
from helpers.worlds import (
    DIRECTIONAL_LIGHT,
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
    world = make_test_world(lights=(POINT_LIGHT,) * 101)
    with pytest.raises(DomainError, match="at most 100 point lights"):
        build_programs(device, world)


def test_largest_number_of_point_lights_compiles(device: GlDevice) -> None:
    assert build_programs(device, make_test_world(lights=(POINT_LIGHT,) * 100)) == (
        "face NUM_POINT_LIGHTS=100",
    )


def test_origin_is_the_centre_of_the_scene(device: GlDevice) -> None:
    world = translate_world(make_test_world(), (1e4, 0.0, -20.0))
    scene = build_scene(world)
    buffers = SceneBuffers(device.context, ShaderPrograms(device.context), scene, world)
    centre = 0.5 * (scene.corners.min((0, 1)) + scene.corners.max((0, 1)))
    assert np.array_equal(buffers.origin, centre)
    buffers.close()


WORLD = make_world(floor_item(), box_item(0.3, 0.1, -0.15, (0.3, 0.2, 0.3)))
PLAIN = CameraState(Pose.from_rpy((0.0, 0.0, -1.0)), TWO_ROBOTS)
SHADOWED = dataclasses.replace(PLAIN, has_shadows=True)


def test_scene_without_and_with_shadows_has_two_sets_of_batches_each_built_once(
    device: GlDevice,
) -> None:
    buffers = SceneBuffers(
        device.context, ShaderPrograms(device.context), build_scene(WORLD), WORLD
    )
    assert buffers.with_lighting(PLAIN) is buffers.plain
    shadowed = buffers.with_lighting(SHADOWED)
    assert shadowed is not buffers.plain
    assert buffers.with_lighting(SHADOWED) is shadowed
    buffers.close()


def test_textures_are_on_the_device_once_for_both_lightings_and_shadow_maps(
    device: GlDevice, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uploaded = []

    def record(texture: ImageTexture, levels: Any, first: int = 0) -> None:
        uploaded.append(texture.image)
        write(texture, levels, first)

    write = ImageTexture.write
    monkeypatch.setattr(ImageTexture, "write", record)
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    scene = pierce_scene(build_scene(world))
    buffers = SceneBuffers(device.context, ShaderPrograms(device.context), scene, world)
    buffers.with_lighting(SHADOWED)
    assert sum(image is scene.textures[0] for image in uploaded) == 1
    buffers.close()


def test_scene_without_shadow_casting_lights_has_one_set_of_batches(device: GlDevice) -> None:
    world = dataclasses.replace(WORLD, lights=(DIM_HEMISPHERE_LIGHT,))
    buffers = SceneBuffers(
        device.context, ShaderPrograms(device.context), build_scene(world), world
    )
    assert buffers.with_lighting(SHADOWED) is buffers.plain
    buffers.close()


def test_objects_when_shadowed_are_rendered_by_a_program_with_shadows(device: GlDevice) -> None:
    programs = ShaderPrograms(device.context)
    buffers = SceneBuffers(device.context, programs, build_scene(WORLD), WORLD)
    scene = buffers.with_lighting(SHADOWED)
    scene.dynamic_objects.upload(TWO_ROBOTS, np.zeros(3))
    scene.set_frame(np.zeros(3))
    (program,) = scene.dynamic_objects.programs
    assert "scene_shadow_maps" in program
    scene.dynamic_objects.upload((), np.zeros(3))
    assert scene.dynamic_objects.programs == set()
    buffers.close()
