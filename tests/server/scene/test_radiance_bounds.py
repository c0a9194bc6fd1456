"""Bounds of the radiance: never exceeded, and close."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.scene import shading
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.dynamic_object import DynamicObject, build_object_mesh
from catoptra_server.scene.primitives import box
from catoptra_server.scene.radiance_bounds import (
    max_facet_irradiance,
    max_object_radiance,
    max_radiance,
)
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    World,
)
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
)


def bound_of(world: World) -> float:
    return max_radiance(build_scene(world), world)


@pytest.mark.parametrize(
    "lights",
    [
        (HEMISPHERE_LIGHT,),
        (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
        (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
    ],
)
def test_image_is_never_brighter_than_the_bound(
    lights: tuple[Light, ...],
) -> None:
    world = make_test_world(lights=lights)
    scene, camera = build_scene(world), make_omni_camera()
    renderer = TraceRenderer(scene, world, threads=1)
    view = renderer.prepare(camera, make_plan(camera))
    assert view.render_linear(CAMERA_STATE).max() <= bound_of(world) * (1.0 + 1e-6)
    renderer.close()


@pytest.mark.parametrize("unlit", [True, False])
def test_brightest_corner_of_a_triangle_counts(unlit: bool) -> None:
    grey = Item("it", Rectangle((1, 1)), Pose.identity(), Material((0.5, 0.5, 0.5), unlit=unlit))
    world = World("w", (grey,), lights=(HemisphereLight((0.9, 0.9, 0.9), (0.0, 0.0, 0.0)),))
    scene = build_scene(world)
    corners = np.repeat(scene.albedo[:, None], 3, axis=1)
    corners[0, 2] = (0.0, 2.0, 0.0)
    brightest = max_radiance(replace(scene, corner_albedo=corners), world)
    assert brightest == pytest.approx(2.0 if unlit else 0.9 * 2.0)


def test_unlit_world_is_as_bright_as_its_background() -> None:
    assert bound_of(World("night", (), background=(0.01, 0.03, 0.02))) == 0.03


def test_world_without_surfaces_is_dark_under_any_light() -> None:
    lights = (HemisphereLight((0.2, 0.2, 0.2), (0.1, 0.1, 0.1)), POINT_LIGHT)
    assert bound_of(World("dusk", (), lights=lights)) == 0.0


def test_texture_counts_with_its_brightest_texel() -> None:
    floor = Item("floor", Rectangle((2, 2)), Pose.identity(), Material((0.5, 0.5, 1.0), unlit=True))
    scene = build_scene(World("w", (floor,)))
    texels = np.zeros((2, 3, 3), dtype=np.uint8)
    texels[1, 2] = (200, 250, 30)
    textured = replace(
        scene, textures=(texels,), texture_index=np.zeros(len(scene), dtype=np.int32)
    )
    brightest = 0.5 * float(linear_from_srgb(np.array(250 / 255)))
    assert max_radiance(textured, World("w", (floor,))) == pytest.approx(brightest)


@pytest.mark.parametrize("seed", range(6))
def test_object_is_never_brighter_than_its_bound_and_half_as_bright_at_least(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lights: tuple[Light, ...] = (
        HemisphereLight((0.4, 0.3, 0.2), (0.1, 0.2, 0.3)),
        DirectionalLight((0.6, 0.0, 0.8), (0.5, 0.6, 0.7)),
        PointLight(tuple(rng.uniform(-2.0, 2.0, 3)), (0.8, 0.9, 1.0)),
    )
    world = World("w", (), lights=lights)
    ball = build_object_mesh([(box(Box((0.1, 0.1, 0.1))), Material((0.9, 0.6, 0.3)))])
    radiances = []
    for _ in range(200):
        pose = Pose.from_rpy(rng.uniform(-1.0, 1.0, 3), rng.uniform(-3.0, 3.0, 3))
        bound = max_object_radiance(DynamicObject(ball, pose), world)
        points = pose.transform_points(ball.corners.reshape(-1, 3))
        normals = np.repeat(ball.normals @ pose.rotation.T, 3, axis=0)
        irradiance = shading.facet_irradiance(lights, normals)
        irradiance += shading.point_irradiance(lights, points, normals)
        brightest = float((np.repeat(ball.albedo, 3, axis=0) * irradiance).max())
        assert brightest <= bound * (1.0 + 1e-12)
        radiances.append(brightest / bound)
    assert max(radiances) > 0.5


def test_floor_under_a_point_light_is_as_bright_as_right_below() -> None:
    floor = Item("floor", Rectangle((2, 2)), Pose.identity(), Material((0.5, 0.5, 0.5)))
    point_light = PointLight((0.3, 0.2, -0.5), (1.0, 1.0, 1.0))
    assert bound_of(World("lamp", (floor,), lights=(point_light,))) == pytest.approx(0.5 / 0.25)


def test_unlit_facet_at_a_point_light_keeps_its_albedo() -> None:
    floor = Item("sign", Rectangle((2, 2)), Pose.identity(), Material((0.5, 0.5, 0.5), unlit=True))
    point_light = PointLight((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert bound_of(World("lamp", (floor,), lights=(point_light,))) == pytest.approx(0.5)
    assert np.isfinite(bound_of(World("lamp", (floor,), lights=(point_light,))))


@pytest.mark.parametrize("seed", range(4))
def test_facets_near_lamps_are_never_brighter_than_their_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (200, 3, 3))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    light = PointLight(tuple(rng.uniform(-1.0, 1.0, 3)), (0.8, 0.9, 1.0))
    bound = max_facet_irradiance(corners, normals, light)
    weights = rng.dirichlet((0.6, 0.6, 0.6), 400)
    points = np.einsum("pk,nki->npi", weights, corners).reshape(-1, 3)
    sampled = shading.point_irradiance((light,), points, np.repeat(normals, 400, axis=0))
    brightest = sampled.reshape(200, 400, 3).max(axis=1)
    assert (brightest <= bound * (1.0 + 1e-9)).all()
    # Facets that face away are dark, and counted as such.
    assert ((bound == 0.0) == (brightest == 0.0)).all()
