from __future__ import annotations

from catoptra_server.render.brightness import largest_radiance
from catoptra_server.render.staging import captured
from catoptra_server.render.summaries import SceneSummaries
from catoptra_server.scene.meshes import build_scene
from helpers.effects import CAMERA, EXPOSURE
from helpers.worlds import room


def test_summary_knows_the_brightest_light_and_how_the_scene_moves() -> None:
    world = room()
    scene = build_scene(world)
    summary = SceneSummaries(scene, world).of(EXPOSURE, CAMERA)
    assert summary.largest_radiance == largest_radiance(scene, world)
    assert summary.motion == captured(EXPOSURE).motion[0]
