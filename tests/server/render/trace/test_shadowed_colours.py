from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.moving_bodies import BodyScenes
from catoptra_server.render.trace.packed_light import LightScale
from catoptra_server.render.trace.ray_colours import RayColours
from catoptra_server.render.trace.renderer import TraceRenderer
from catoptra_server.render.trace.shadowed_colours import LitTriangles, ShadowedColours
from catoptra_server.scene.description import Material, World
from catoptra_server.scene.meshes import build_scene
from helpers.bodies import TWO_ROBOTS
from helpers.pictures import level_differences
from helpers.shadows import DUSK, SUN, box_at, floor, world_of
from helpers.worlds import LAMP, SKY, VIEW, omni_camera, raster_plan, room, smooth_texture

NONE = np.zeros(0, dtype=np.intp)


def colours_of(world: World) -> tuple[ShadowedColours, RayColours]:
    scene = build_scene(world)
    embree, bodies = EmbreeScene(scene, world), BodyScenes(world.lights)
    scale = LightScale.for_samples(1)
    lit = LitTriangles(embree, scene, world)
    return ShadowedColours(embree, bodies, scale, lit), RayColours(embree, bodies, scale)


def test_light_when_nothing_is_hidden_is_that_without_shadows(tmp_path: Path) -> None:
    look = Material((0.5, 0.5, 0.5), smooth_texture(tmp_path / "waves.png"))
    world = world_of(floor(material=look), lights=(DUSK, SUN, LAMP))
    rays = np.random.default_rng(1).normal(size=(2000, 3)).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    exposure = dataclasses.replace(VIEW, has_shadows=True)
    found = [
        colours.of_rays(rays, colours.placed(exposure), off_mirror=NONE).astype(int)
        for colours in colours_of(world)
    ]
    # The lights are added in another order.
    assert np.abs(found[0] - found[1]).max() <= 1


def test_light_when_facets_are_turned_away_or_shine_themselves_does_not_vary() -> None:
    shadowed, plain = colours_of(world_of(floor(), box_at(0, 0, -0.2, (0.2, 0.2, 0.2))))
    normals = shadowed.scene.met  # the same scene: one commit serves both
    assert normals == plain.scene.met
    triangles = np.arange(-1, 14, dtype=np.int32)
    varies = shadowed.varies(triangles)
    assert not varies[0], "the background"
    assert varies[1:3].all(), "the floor under the sun"
    assert 0 < varies[3:].sum() < 12, "half of the box"
    assert not plain.varies(triangles).any()


@pytest.mark.parametrize("stride_px", [1, 4])
@pytest.mark.parametrize("lights", [(SKY, SUN), (SKY, SUN, LAMP)])
def test_cells_when_filled_show_the_shadows_of_all_rays(lights: tuple, stride_px: int) -> None:
    world, camera = room(lights=lights), omni_camera()
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    exposure = dataclasses.replace(VIEW, has_shadows=True, bodies=TWO_ROBOTS)
    plans = [
        dataclasses.replace(raster_plan(camera, samples=2), stride_px=stride)
        for stride in (1, stride_px)
    ]
    whole, filled = (renderer.prepare(camera, plan).draw(exposure).rgb for plan in plans)
    renderer.close()
    difference = level_differences(whole, filled)
    # Places of filled cells are computed on planes: a ray at a shadow's outline may go either way.
    assert (difference > 1).mean() < 1e-3
