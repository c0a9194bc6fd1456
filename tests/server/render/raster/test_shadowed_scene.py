from __future__ import annotations

import dataclasses

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.shadows import DIM_HEMISPHERE_LIGHT, box_item, floor_item, make_world

WORLD = make_world(floor_item(), box_item(0.3, 0.1, -0.15, (0.3, 0.2, 0.3)))
PLAIN = CameraState(Pose.from_rpy((0.0, 0.0, -1.0)), TWO_ROBOTS)
SHADOWED = dataclasses.replace(PLAIN, has_shadows=True)


def test_scene_without_and_with_shadows_has_two_sets_of_batches_each_built_once(
    device: GlDevice,
) -> None:
    buffers = SceneBuffers(
        device.context, ShaderPrograms(device.context), build_scene(WORLD), WORLD
    )
    assert buffers.with_lighting(PLAIN) is buffers
    shadowed = buffers.with_lighting(SHADOWED)
    assert shadowed is not buffers
    assert buffers.with_lighting(SHADOWED) is shadowed
    buffers.close()


def test_scene_without_shadow_casting_lights_has_one_set_of_batches(device: GlDevice) -> None:
    world = dataclasses.replace(WORLD, lights=(DIM_HEMISPHERE_LIGHT,))
    buffers = SceneBuffers(
        device.context, ShaderPrograms(device.context), build_scene(world), world
    )
    assert buffers.with_lighting(SHADOWED) is buffers
    buffers.close()


def test_objects_when_shadowed_are_rendered_by_a_program_with_shadows(
    device: GlDevice,
) -> None:
    programs = ShaderPrograms(device.context)
    buffers = SceneBuffers(device.context, programs, build_scene(WORLD), WORLD)
    scene = buffers.with_lighting(SHADOWED)
    scene.dynamic_objects.upload(TWO_ROBOTS)
    scene.set_frame(np.zeros(3), (1.0, -0.1))
    (program,) = scene.dynamic_objects.programs
    assert "scene_shadow_maps" in program
    scene.dynamic_objects.upload(())
    assert scene.dynamic_objects.programs == set()
    buffers.close()
