from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_server.render.raster.gl_device import GlDevice
from catoptra_server.render.raster.scene_batches import FacetLighting, SceneBatches, make_attribute
from catoptra_server.render.raster.shader_programs import ShaderPrograms
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.triangle_clusters import make_clusters
from helpers.worlds import (
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_test_world,
    write_smooth_texture,
)


def test_batches_when_light_varies_by_position_have_the_programs_that_need_normals(
    device: GlDevice, tmp_path: Path
) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "t.png"),
    )
    scene = build_scene(world)
    chunks = make_clusters(scene.corners, (scene.texture_index + 1).astype(np.intp))
    position = make_attribute(device.context, scene.corners[chunks.order])
    built = []
    for varying in ((), (("NUM_POINT_LIGHTS", 1),)):
        programs = ShaderPrograms(device.context)
        light = FacetLighting(world.lights, varying)
        look = SceneBatches(
            device.context, programs, scene, chunks, position=position, lighting=light
        )
        assert len(look.programs) == 2
        built.append(programs.names)
        look.close()
    assert built == [
        ("face", "face TEXTURED=1"),
        ("face NUM_POINT_LIGHTS=1", "face TEXTURED=1 NUM_POINT_LIGHTS=1"),
    ]
    position[0].release()
