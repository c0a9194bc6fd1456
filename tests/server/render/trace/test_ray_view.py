"""Rays in chunks: each pixel once, and the same image as all rays together."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import SrgbScale
from catoptra_server.render.trace.ray_samples import omni_rays
from catoptra_server.render.trace.ray_shader import UnshadowedShader
from catoptra_server.render.trace.ray_view import RayView, split_rays
from catoptra_server.scene.scene_mesh import build_scene
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_plan, make_test_world

CAMERA = make_omni_camera(width_px=240)


@pytest.mark.parametrize("samples", [1, 2])
def test_chunks_have_every_ray_once(samples: int) -> None:
    rays = omni_rays(CAMERA, make_plan(CAMERA, samples=samples))
    chunks = split_rays(rays)
    assert len(chunks) == 2 if samples == 1 else len(chunks) > 2
    np.testing.assert_array_equal(np.concatenate([c.pixels for c in chunks]), rays.pixels)
    np.testing.assert_array_equal(np.concatenate([c.directions for c in chunks]), rays.directions)
    assert sum(len(c.off_mirror) for c in chunks) == np.count_nonzero(~rays.on_mirror)


def test_rays_when_there_are_none_are_no_chunks() -> None:
    rays = omni_rays(CAMERA, make_plan(CAMERA))
    assert split_rays(rays.select(np.zeros(len(rays.pixels), dtype=bool))) == []


def test_image_when_rendered_is_that_of_all_rays_at_once() -> None:
    world = make_test_world()
    rays = omni_rays(CAMERA, make_plan(CAMERA, samples=2))
    scene, objects = EmbreeScene(build_scene(world), world), EmbreeObjectScenes(world.lights)
    colours = UnshadowedShader(scene, objects, SrgbScale.for_samples(4))
    with ThreadPoolExecutor(2) as pool:
        image = RayView(colours, rays, pool).render(CAMERA_STATE).rgb
    off = np.flatnonzero(~rays.on_mirror)
    expected = colours.shade_rays(
        rays.directions, colours.transform_view(CAMERA_STATE), off_mirror=off
    )
    np.testing.assert_array_equal(image.reshape(-1, 3)[rays.pixels], expected)
