"""Bounds of radiance and irradiance: never exceeded, and close."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.light_loss import (
    ObjectRadiances,
    max_facet_irradiance,
    max_radiance,
)
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shading import facet_irradiance, point_irradiance
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    Twist,
    World,
    linear_from_srgb,
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
def test_image_is_never_brighter_than_the_bound(lights: tuple[Light, ...]) -> None:
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


def test_floor_under_a_point_light_is_as_bright_as_right_below() -> None:
    floor = Item("floor", Rectangle((2, 2)), Pose.identity(), Material((0.5, 0.5, 0.5)))
    point_light = PointLight((0.3, 0.2, -0.5), (1.0, 1.0, 1.0))
    assert bound_of(World("lamp", (floor,), lights=(point_light,))) == pytest.approx(0.5 / 0.25)


def test_unlit_facet_at_a_point_light_keeps_its_albedo() -> None:
    floor = Item("sign", Rectangle((2, 2)), Pose.identity(), Material((0.5, 0.5, 0.5), unlit=True))
    point_light = PointLight((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert bound_of(World("lamp", (floor,), lights=(point_light,))) == pytest.approx(0.5)
    assert np.isfinite(bound_of(World("lamp", (floor,), lights=(point_light,))))


def sample_radiance(scene: SceneMesh, world: World, rng: np.random.Generator) -> float:
    """Largest radiance of many points of untextured facets of one albedo, without shadows."""
    weights = rng.dirichlet((0.7, 0.7, 0.7), 4000)
    points = np.einsum("pk,nki->npi", weights, scene.corners).reshape(-1, 3)
    normals = np.repeat(scene.normals, len(weights), axis=0)
    irradiance = facet_irradiance(world.lights, normals)
    irradiance += point_irradiance(world.lights, points, normals)
    return float((np.repeat(scene.albedo, len(weights), axis=0) * irradiance).max())


@pytest.mark.parametrize("seed", range(8))
def test_scene_under_many_lamps_is_a_tenth_less_bright_than_its_bound_at_most(seed: int) -> None:
    rng = np.random.default_rng(seed)
    items = [Item("floor", Rectangle((30, 20)), Pose.identity(), Material((0.7, 0.5, 0.3)))]
    for number in range(3 * seed):
        pose = Pose.from_rpy(rng.uniform(-8.0, 8.0, 3), rng.uniform(-3.0, 3.0, 3))
        shape, colour = Rectangle(tuple(rng.uniform(0.1, 9.0, 2))), tuple(rng.uniform(0.0, 1.0, 3))
        items.append(Item(f"wall {number}", shape, pose, Material(colour)))
    lamps = [
        PointLight((*rng.uniform(-7.0, 7.0, 2), -3.0), tuple(rng.uniform(1.0, 4.0, 3)))
        for _ in range(4)
    ]
    world = World("hall", tuple(items), lights=(DIRECTIONAL_LIGHT, *lamps))
    scene = build_scene(world)
    sampled = sample_radiance(scene, world, rng)
    assert sampled <= bound_of(world) * (1.0 + 1e-9)
    # Sampled points miss the brightest one by little: it may lie right at a lamp on a wall.
    assert bound_of(world) < 1.3 * sampled


def test_four_lamps_over_one_floor_do_not_stand_over_one_point() -> None:
    floor = Item("floor", Rectangle((30, 20)), Pose.identity(), Material((0.5, 0.5, 0.5)))
    lamps = tuple(
        PointLight((x, y, -3.0), (9.0, 9.0, 9.0)) for x in (-9.0, 9.0) for y in (-6.0, 6.0)
    )
    world = World("hall", (floor,), lights=lamps)
    sampled = sample_radiance(build_scene(world), world, np.random.default_rng(1))
    assert sampled <= bound_of(world) < 1.11 * sampled


def test_many_facets_of_one_brightness_are_bounded_without_pieces() -> None:
    tile = Item("tile", Rectangle((0.02, 0.02)), Pose.identity(), Material((0.5, 0.5, 0.5)))
    tiles = tuple(
        replace(
            tile, name=f"tile {x} {y}", world_from_item=Pose.from_rpy((0.02 * x, 0.02 * y, 0.0))
        )
        for x in range(-25, 25)
        for y in range(-50, 50)
    )
    world = World("floor", tiles, lights=(PointLight((0.0, 0.0, -40.0), (900.0,) * 3),))
    assert bound_of(world) == pytest.approx(0.5 * 900.0 / 40.0**2, rel=1e-3)


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
    bounds, radiances = ObjectRadiances(world), []
    for _ in range(200):
        pose = Pose.from_rpy(rng.uniform(-1.0, 1.0, 3), rng.uniform(-3.0, 3.0, 3))
        bound = bounds.max_radiance((DynamicObject(ball, pose),))
        points = pose.transform_points(ball.corners.reshape(-1, 3))
        normals = np.repeat(ball.normals @ pose.rotation.T, 3, axis=0)
        irradiance = facet_irradiance(lights, normals)
        irradiance += point_irradiance(lights, points, normals)
        brightest = float((np.repeat(ball.albedo, 3, axis=0) * irradiance).max())
        assert brightest <= bound * (1.0 + 1e-12)
        radiances.append(brightest / bound)
    assert max(radiances) > 0.5


@pytest.mark.parametrize("num_lamps", [0, 1, 3])
def test_brightest_of_several_objects_counts(num_lamps: int) -> None:
    rng = np.random.default_rng(3)
    lamps = [
        PointLight(tuple(rng.uniform(-3.0, 3.0, 3)), (0.8, 0.9, 1.0)) for _ in range(num_lamps)
    ]
    bounds = ObjectRadiances(
        World("w", (), lights=(HemisphereLight((0.4,) * 3, (0.1,) * 3), *lamps))
    )
    meshes = [
        build_object_mesh([(box(Box((0.1, 0.2, 0.3))), Material((grey, 0.3, 0.3)))])
        for grey in (0.2, 0.7)
    ]
    objects = [
        DynamicObject(
            mesh, Pose.from_rpy(rng.uniform(-2.0, 2.0, 3)), Twist((rng.uniform(), 0.0, 0.0))
        )
        for mesh in meshes * 3
    ]
    alone = [bounds.max_radiance((one,)) for one in objects]
    assert bounds.max_radiance(objects) == pytest.approx(max(alone))
    assert len(set(alone)) == (6 if num_lamps else 2)
    assert bounds.max_radiance(()) == 0.0


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
    sampled = point_irradiance((light,), points, np.repeat(normals, 400, axis=0))
    brightest = sampled.reshape(200, 400, 3).max(axis=1)
    assert (brightest <= bound * (1.0 + 1e-9)).all()
    # Facets that face away are dark, and counted as such.
    assert ((bound == 0.0) == (brightest == 0.0)).all()
