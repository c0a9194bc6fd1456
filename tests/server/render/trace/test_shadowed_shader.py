from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import SrgbScale
from catoptra_server.render.trace.ray_shader import UnshadowedShader
from catoptra_server.render.trace.shadowed_shader import ShadowedShader, ShadowReceivers
from catoptra_server.render.trace.trace_renderer import TraceRenderer
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import Material, World
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.image_comparison import level_differences
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    box_item,
    floor_item,
    make_world,
)
from helpers.worlds import (
    CAMERA_STATE,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
    write_smooth_texture,
)

NONE = np.zeros(0, dtype=np.intp)


def render_colours(world: World) -> tuple[ShadowedShader, UnshadowedShader]:
    scene = build_scene(world)
    embree, objects = EmbreeScene(scene, world), EmbreeObjectScenes(world.lights)
    scale = SrgbScale.for_samples(1)
    lit = ShadowReceivers(embree, scene, world)
    return ShadowedShader(embree, objects, scale, lit), UnshadowedShader(embree, objects, scale)


def test_light_when_nothing_is_occluded_is_that_without_shadows(tmp_path: Path) -> None:
    look = Material((0.5, 0.5, 0.5), write_smooth_texture(tmp_path / "waves.png"))
    world = make_world(
        floor_item(material=look), lights=(DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT)
    )
    rays = np.random.default_rng(1).normal(size=(2000, 3)).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    camera_state = dataclasses.replace(CAMERA_STATE, has_shadows=True)
    found = [
        colours.shade_rays(rays, colours.transform_view(camera_state), off_mirror=NONE).astype(int)
        for colours in render_colours(world)
    ]
    # The lights are added in another order.
    assert np.abs(found[0] - found[1]).max() <= 1


def test_light_when_facets_are_turned_away_or_unlit_does_not_vary() -> None:
    shadowed, plain = render_colours(
        make_world(floor_item(), box_item(0, 0, -0.2, (0.2, 0.2, 0.2)))
    )
    normals = shadowed.scene.intersect  # the same scene: one commit serves both
    assert normals == plain.scene.intersect
    triangles = np.arange(-1, 14, dtype=np.int32)
    varies = shadowed.has_varying_light(triangles)
    assert not varies[0], "the background"
    assert varies[1:3].all(), "the floor under the directional light"
    assert 0 < varies[3:].sum() < 12, "half of the box"
    assert not plain.has_varying_light(triangles).any()


@pytest.mark.parametrize("stride_px", [1, 4])
@pytest.mark.parametrize(
    "lights",
    [(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT), (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT)],
)
def test_cells_when_filled_show_the_shadows_of_all_rays(lights: tuple, stride_px: int) -> None:
    world, camera = make_test_world(lights=lights), make_omni_camera()
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    camera_state = dataclasses.replace(CAMERA_STATE, has_shadows=True, objects=TWO_ROBOTS)
    plans = [
        dataclasses.replace(make_plan(camera, samples=2), stride_px=stride)
        for stride in (1, stride_px)
    ]
    whole, filled = (renderer.prepare(camera, plan).render(camera_state).rgb for plan in plans)
    renderer.close()
    difference = level_differences(whole, filled)
    # Places of filled cells are computed on planes: a ray at a shadow's outline may go either way.
    assert (difference > 1).mean() < 1e-3
