from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_server.render.chunks import make_chunks
from catoptra_server.render.raster.context import GlDevice
from catoptra_server.render.raster.programs import Programs
from catoptra_server.render.raster.scene_look import FacetLight, SceneLook, attribute
from catoptra_server.scene.meshes import build_scene
from helpers.worlds import LAMP, SKY, SUN, room, smooth_texture


def test_look_when_light_varies_by_place_alone_has_the_programs_that_need_normals(
    device: GlDevice, tmp_path: Path
) -> None:
    world = room(lights=(SKY, SUN, LAMP), texture=smooth_texture(tmp_path / "t.png"))
    scene = build_scene(world)
    chunks = make_chunks(scene.corners, (scene.texture_index + 1).astype(np.intp))
    position = attribute(device.context, scene.corners[chunks.order])
    built = []
    for varying in ((), (("POINT_LIGHTS", 1),)):
        programs = Programs(device.context)
        light = FacetLight(world.lights, varying)
        look = SceneLook(device.context, programs, scene, chunks, position=position, light=light)
        assert len(look.programs) == 2
        built.append(programs.built)
        look.close()
    assert built == [
        ("face", "face TEXTURED=1"),
        ("face POINT_LIGHTS=1", "face TEXTURED=1 POINT_LIGHTS=1"),
    ]
    position[0].release()
