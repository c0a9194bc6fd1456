"""Shadows are found by planes where rays find any, and lose as much light as any point loses."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.effects.bounds import shadow_bounds
from catoptra_server.effects.bounds.light_loss import grey_level_change
from catoptra_server.effects.bounds.shadow_bounds import LightShafts, ShadowBounds
from catoptra_server.world.objects import DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shading import (
    ShadowCastingLight,
    facet_irradiance,
    hemisphere_lights,
    shadow_casting_lights,
    unshadowed_irradiance,
)
from catoptra_server.world.shapes import box, facet_normals
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    SphereBand,
    World,
    srgb_from_linear,
)
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    GREY,
    POINT_LIGHT,
    box_item,
    floor_item,
    make_inward_facing_room,
    make_world,
    reference_radiance,
)
from helpers.standing_things import bake_scene, make_box_world

NUM_POINTS = 200


def make_random_light(rng: np.random.Generator) -> PointLight | DirectionalLight:
    if rng.uniform() < 0.5:
        place = rng.uniform((-1.5, -1.5, -1.5), (1.5, 1.5, -0.05))
        return PointLight(tuple(place), tuple(rng.uniform(0.05, 0.8, 3)))
    direction = rng.normal(size=3)
    direction[2] = abs(direction[2])
    return DirectionalLight(tuple(direction / np.linalg.norm(direction)), (0.5, 0.4, 0.3))


def make_random_world(seed: int) -> World:
    """Boxes that stand on a floor, touch or hover, some around a lamp, some letting light pass."""
    rng = np.random.default_rng(seed)
    lights = tuple(make_random_light(rng) for _ in range(rng.integers(1, 3)))
    items = [floor_item(3.0)]
    for number in range(rng.integers(0, 4)):
        size = rng.uniform(0.05, 0.8, 3)
        x, y, z = rng.uniform((-1.0, -1.0, -1.2), (1.0, 1.0, 0.0))
        z = -0.5 * size[2] if rng.uniform() < 0.5 else z
        pose = Pose.from_rpy((x, y, z), tuple(rng.uniform(-0.5, 0.5, 3) * (rng.uniform() < 0.3)))
        material = Material(tuple(rng.uniform(0.1, 1.0, 3)), unlit=bool(rng.uniform() < 0.1))
        casts = bool(rng.uniform() < 0.9)
        items.append(Item(f"b{number}", Box(tuple(size)), pose, material, casts_shadows=casts))
    return make_world(*items, lights=(DIM_HEMISPHERE_LIGHT, *lights))


def sample_points(scene: SceneMesh, rng: np.random.Generator) -> tuple[np.ndarray, Floats]:
    """(k,) triangles and (k, 3) points on them, many of them near an edge."""
    triangle = np.repeat(np.arange(len(scene)), NUM_POINTS)
    weights = rng.dirichlet((0.5, 0.5, 0.5), len(triangle))
    return triangle, np.einsum("nc,nci->ni", weights, scene.corners[triangle])


def find_hidden(world: World, scene: SceneMesh, light: Light, rng: np.random.Generator) -> Bools:
    """(n,) triangles that lose the light at some of their points, by shadow rays."""
    alone = World(world.name, world.items, lights=(light,))
    triangle, points = sample_points(scene, rng)
    dark, is_certain = reference_radiance(scene, alone, triangle, points)
    normals = scene.normals[triangle]
    full = scene.albedo[triangle] * unshadowed_irradiance(light, points, normals)
    lost = ((full - dark).max(axis=-1) > 1e-9) & is_certain & ~scene.unlit[triangle]
    hidden: Bools = lost.reshape(-1, NUM_POINTS).any(axis=1)
    return hidden


def suspect(scene: SceneMesh, light: ShadowCastingLight) -> Bools:
    """(n,) triangles that are hidden by planes."""
    shafts = LightShafts(scene, light)
    hidden, pairs_left = shafts.find_hidden(np.arange(len(scene)), 10**9)
    assert pairs_left > 0
    return hidden


def bound_scene(scene: SceneMesh, world: World, *bodies: DynamicObject) -> ShadowLoss:
    bounds = ShadowBounds(scene, world)
    return bounds.darkest_shadow(bodies)


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_no_triangle_of_random_worlds_is_hidden_that_counts_as_lit(first: int) -> None:
    num_hidden = num_suspected = 0
    for seed in range(first, first + 10):
        world, rng = make_random_world(seed), np.random.default_rng(seed + 1000)
        scene = build_scene(world)
        for light in shadow_casting_lights(world.lights):
            hidden = find_hidden(world, scene, light, rng)
            suspected = suspect(scene, light)
            facing = unshadowed_irradiance(light, scene.corners.mean(axis=1), scene.normals).any(
                axis=-1
            )
            assert not (hidden & ~suspected).any(), seed
            num_hidden += int(hidden.sum())
            num_suspected += int((suspected & facing & ~scene.unlit).sum())
    # What only points between the samples lose, or only a sliver.
    assert num_hidden > 20
    assert num_suspected < 1.25 * num_hidden


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_bound_of_random_worlds_is_never_below_the_largest_change(first: int) -> None:
    for seed in range(first, first + 10):
        world, rng = make_random_world(seed), np.random.default_rng(seed + 2000)
        scene = build_scene(world)
        triangle, points = sample_points(scene, rng)
        dark, is_certain = reference_radiance(scene, world, triangle, points)
        irradiance = facet_irradiance(hemisphere_lights(world.lights), scene.normals[triangle])
        for light in shadow_casting_lights(world.lights):
            irradiance += unshadowed_irradiance(light, points, scene.normals[triangle])
        bright = scene.albedo[triangle] * np.where(scene.unlit[triangle, None], 1.0, irradiance)
        levels = [255.0 * srgb_from_linear(np.minimum(x, 1.0)) for x in (bright, dark)]
        change = np.where(is_certain[:, None], levels[0] - levels[1], 0.0).max()
        bound = grey_level_change(bound_scene(scene, world))
        assert bound >= change - 1e-9, seed
        assert bound == 0.0 or change > 0.0, seed


def test_room_of_walls_with_backs_around_its_lamp_loses_nothing() -> None:
    # Slabs that touch along edges: planes of their other sides lie between lamp and walls.
    lamp = PointLight((0.3, 0.2, -1.1), (0.9, 0.9, 0.9))
    slabs = (
        ((0.0, 0.0, 0.05), (4.0, 4.0, 0.1)),
        ((0.0, 0.0, -2.05), (4.0, 4.0, 0.1)),
        ((2.05, 0.0, -1.0), (0.1, 4.0, 2.0)),
        ((-2.05, 0.0, -1.0), (0.1, 4.0, 2.0)),
        ((0.0, 2.05, -1.0), (4.0, 0.1, 2.0)),
        ((0.0, -2.05, -1.0), (4.0, 0.1, 2.0)),
    )
    items = [
        Item(f"slab{n}", Box(size), Pose.from_rpy(place), GREY)
        for n, (place, size) in enumerate(slabs)
    ]
    world = make_world(*items, lights=(DIM_HEMISPHERE_LIGHT, lamp))
    assert grey_level_change(bound_scene(build_scene(world), world)) == 0.0


def test_shadow_of_a_box_on_a_floor_away_from_all_others_is_found() -> None:
    world = make_world(floor_item(), box_item(0.5, 0.0, -0.15, (0.2, 0.2, 0.3)))
    scene = build_scene(world)
    light = shadow_casting_lights(world.lights)[0]
    names = {scene.item_names[scene.item_index[i]] for i in np.flatnonzero(suspect(scene, light))}
    assert "floor" in names


def make_bumps(quads: int, *, height_m: float) -> SceneMesh:
    """Bumpy ground of 2 quads^2 triangles that the lights of a world can see."""
    x, y = np.meshgrid(*2 * [np.linspace(-2.0, 2.0, quads + 1)], indexing="ij")
    points = np.stack((x, y, height_m * np.sin(5.0 * x) * np.cos(7.0 * y)), axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return repeat_floor(np.stack((a, c, b, a, d, c), axis=-2).reshape(-1, 3, 3))


def repeat_floor(corners: Floats) -> SceneMesh:
    """Scene of (n, 3, 3) triangles with the looks of a floor's first one."""
    floor = build_scene(make_world(floor_item()))
    arrays = {
        field.name: np.repeat(value[:1], len(corners), axis=0)
        for field in fields(SceneMesh)
        if field.init and isinstance(value := getattr(floor, field.name), np.ndarray)
    }
    return replace(floor, **arrays | {"corners": corners, "normals": facet_normals(corners)[0]})


@pytest.mark.parametrize("light", [DIRECTIONAL_LIGHT, POINT_LIGHT])
def test_hierarchy_finds_what_all_pairs_of_triangles_find(light: ShadowCastingLight) -> None:
    scene = make_bumps(30, height_m=0.3)
    shafts = LightShafts(scene, light)
    towards = shafts._towards(scene.corners[:, 0])
    receivers = np.flatnonzero(np.einsum("ni,ni->n", scene.normals, towards) > 0.0)[::7]
    receiver, rows = np.indices((len(receivers), len(scene))).reshape(2, -1)
    expected = np.isin(np.arange(len(receivers)), shafts._select_hidden(receivers, receiver, rows))
    assert 0 < np.count_nonzero(expected) < len(receivers)
    hidden, pairs_left = shafts.find_hidden(receivers, 10**9)
    assert pairs_left > 0
    np.testing.assert_array_equal(hidden, expected)
    # What is not tested counts as hidden.
    for most in (0, 20_000):
        assert not (expected & ~shafts.find_hidden(receivers, most)[0]).any()


def test_triangles_without_a_shadow_change_no_loss_however_many_there_are() -> None:
    lights = (DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)
    for items in ((floor_item(),), (floor_item(), box_item(0.5, 0.0, -0.15, (0.2, 0.2, 0.3)))):
        world = make_world(*items, lights=lights)
        alone = bound_scene(build_scene(world), world)
        sky = Item(
            "sky",
            SphereBand(50.0, 0.0, 3.1, sectors=500, rings=101),
            Pose.identity(),
            Material((0.5, 0.6, 0.9), unlit=True),
            casts_shadows=False,
        )
        under_sky = make_world(*items, sky, lights=lights)
        scene = build_scene(under_sky)
        assert len(scene) > 100_000
        assert bound_scene(scene, under_sky) == alone


def test_loss_of_many_triangles_in_shadow_is_that_of_few() -> None:
    losses = []
    for quads in (30, 240):
        scene = make_bumps(quads, height_m=0.6)
        world = make_world(floor_item(), lights=(DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT))
        losses.append(grey_level_change(bound_scene(scene, world)))
    assert losses[1] == pytest.approx(losses[0], rel=0.05)


INSIDE = PointLight((0.3, 0.2, -1.1), (0.9, 0.9, 0.9))


@pytest.mark.parametrize("light", [DIRECTIONAL_LIGHT, POINT_LIGHT])
def test_floor_loses_light_to_a_box_above_alone_and_hides_one_below(light: Light) -> None:
    lights = (DIM_HEMISPHERE_LIGHT, light)
    assert bound(make_world(floor_item(), lights=lights)) == NO_SHADOW_LOSS
    for z in (-0.1, 0.5):
        world = make_world(floor_item(), box_item(0, 0, z, (0.2, 0.2, 0.2)), lights=lights)
        assert bound(world) != NO_SHADOW_LOSS


@pytest.mark.parametrize(
    ("world", "light"),
    [
        (make_inward_facing_room(INSIDE), INSIDE),
        (make_world(box_item(0, 0, -0.1, (0.2, 0.2, 0.2))), DIRECTIONAL_LIGHT),
        (World("empty", ()), DIRECTIONAL_LIGHT),
    ],
    ids=["convex room around its lamp", "single box", "no triangles"],
)
def test_convex_scene_loses_nothing(world: World, light: Light) -> None:
    assert bound(replace(world, lights=(light,))) == NO_SHADOW_LOSS


def test_box_in_place_of_many_corners_changes_no_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    worlds = [make_random_world(seed) for seed in range(20)]
    exact = [bound(world) for world in worlds]
    monkeypatch.setattr(shadow_bounds, "_MAX_PRODUCTS", 0)
    assert [grey_level_change(bound(world)) for world in worlds] == pytest.approx(
        [grey_level_change(loss) for loss in exact]
    )


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("axis", range(3))
def test_box_in_place_of_many_corners_reaches_as_far_as_a_caster_on_any_side(
    monkeypatch: pytest.MonkeyPatch, axis: int, sign: float
) -> None:
    monkeypatch.setattr(shadow_bounds, "_MAX_PRODUCTS", 0)
    x, y, z = (sign * np.eye(3)[axis]).tolist()
    light = DirectionalLight((-x, -y, -z), (0.5, 0.5, 0.5))
    items = box_item(0.0, 0.0, 0.0, (0.4, 0.4, 0.4)), box_item(x, y, z, (0.2, 0.2, 0.2))
    assert bound(make_world(*items, lights=(DIM_HEMISPHERE_LIGHT, light))) != NO_SHADOW_LOSS


SKY = HemisphereLight((0.3, 0.3, 0.3), (0.2, 0.2, 0.2))
NOON = DirectionalLight((0.0, 0.0, 1.0), (0.5, 0.5, 0.5))
MESH = build_object_mesh([(box(Box((0.2, 0.2, 0.2))), GREY)])
BOX = box_item(0.0, 0.0, -0.2, (0.2, 0.2, 0.2))


def bound(world: World, *bodies: DynamicObject) -> ShadowLoss:
    return bound_scene(build_scene(world), world, *bodies)


def test_floor_under_a_box_loses_the_directional_light_and_keeps_the_sky() -> None:
    shade = bound(make_world(floor_item(), BOX, lights=(SKY, NOON)))
    assert shade.lost_radiance == pytest.approx(0.5 * 0.5)
    assert shade.remaining_radiance == pytest.approx(0.5 * 0.3)


def test_brightest_corner_of_a_triangle_counts() -> None:
    world = make_world(floor_item(), BOX, lights=(SKY, NOON))
    scene = build_scene(world)
    corners = np.repeat(scene.albedo[:, None], 3, axis=1)
    corners[:, 1] = 0.8
    shade = bound_scene(replace(scene, corner_albedo=corners), world)
    assert shade.lost_radiance == pytest.approx(0.8 * 0.5)
    assert shade.remaining_radiance == pytest.approx(0.8 * 0.3)


def test_floor_keeps_a_directional_light_that_nothing_occludes() -> None:
    away = DirectionalLight((0.0, 0.0, -1.0), (0.4, 0.4, 0.4))
    shade = bound(make_world(floor_item(), BOX, lights=(SKY, NOON, away)))
    assert (shade.lost_radiance, shade.remaining_radiance) == pytest.approx((0.25, 0.15))


def test_floor_alone_loses_nothing_until_an_object_comes() -> None:
    world = make_world(floor_item(), lights=(SKY, NOON))
    assert bound(world) == NO_SHADOW_LOSS
    # White, facing the directional light, in the dimmer half of the sky.
    shade = bound(world, DynamicObject(MESH, Pose.identity()))
    assert (shade.lost_radiance, shade.remaining_radiance) == pytest.approx(
        (0.5 / 0.7, 0.2 / 0.7)
    ) or (shade.lost_radiance, shade.remaining_radiance) == pytest.approx((0.5, 0.2))


def test_object_near_a_point_light_may_lose_more_than_the_floor() -> None:
    point_light = PointLight((0.0, 0.0, -2.0), (0.1, 0.1, 0.1))
    world = make_world(floor_item(), lights=(SKY, point_light))
    far, near = (bound(world, DynamicObject(MESH, Pose.from_rpy((0, 0, -z)))) for z in (0.2, 1.5))
    assert near.lost_radiance > 2.0 * far.lost_radiance


def test_world_with_a_hemisphere_light_alone_loses_nothing() -> None:
    assert (
        bound(make_world(floor_item(), BOX, lights=(SKY,)), DynamicObject(MESH, Pose.identity()))
        == NO_SHADOW_LOSS
    )


def test_hidden_sky_makes_a_shadow_more_visible() -> None:
    world = make_box_world(lights=(SKY, NOON))
    hidden = bake_scene(world)
    whole = bound_scene(build_scene(world), world)
    dim = bound_scene(hidden, world)
    assert grey_level_change(dim) > grey_level_change(whole)
