"""Hidden triangles by planes, against shadow rays from many of their points."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.light import grey_level_change
from catoptra_server.effects.bounds.shadows import LightShafts, ShadowBounds
from catoptra_server.world import shading
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    Item,
    Light,
    Material,
    PointLight,
    World,
    srgb_from_linear,
)
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    GREY,
    box_item,
    floor_item,
    make_inward_facing_room,
    make_world,
    reference_radiance,
)

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
    full = scene.albedo[triangle] * shading.unshadowed_irradiance(light, points, normals)
    lost = ((full - dark).max(axis=-1) > 1e-9) & is_certain & ~scene.unlit[triangle]
    hidden: Bools = lost.reshape(-1, NUM_POINTS).any(axis=1)
    return hidden


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_no_triangle_of_random_worlds_is_hidden_that_counts_as_lit(first: int) -> None:
    num_hidden = num_suspected = 0
    for seed in range(first, first + 10):
        world, rng = make_random_world(seed), np.random.default_rng(seed + 1000)
        scene = build_scene(world)
        for light in shading.shadow_casting_lights(world.lights):
            shafts = LightShafts(scene, light)
            hidden = find_hidden(world, scene, light, rng)
            suspected = np.array([shafts.can_be_hidden(i) for i in range(len(scene))])
            facing = shading.unshadowed_irradiance(
                light, scene.corners.mean(axis=1), scene.normals
            ).any(axis=-1)
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
        irradiance = shading.facet_irradiance(
            shading.hemisphere_lights(world.lights), scene.normals[triangle]
        )
        for light in shading.shadow_casting_lights(world.lights):
            irradiance += shading.unshadowed_irradiance(light, points, scene.normals[triangle])
        bright = scene.albedo[triangle] * np.where(scene.unlit[triangle, None], 1.0, irradiance)
        levels = [255.0 * srgb_from_linear(np.minimum(x, 1.0)) for x in (bright, dark)]
        change = np.where(is_certain[:, None], levels[0] - levels[1], 0.0).max()
        bound = grey_level_change(ShadowBounds(scene, world).darkest_shadow(()))
        assert bound >= change - 1e-9, seed
        assert bound == 0.0 or change > 0.0, seed


def test_convex_room_around_its_lamp_and_a_box_alone_lose_nothing() -> None:
    lamp = PointLight((0.3, 0.2, -1.1), (0.9, 0.9, 0.9))
    worlds = [
        make_inward_facing_room(lamp),
        make_world(box_item(0.0, 0.0, -0.2, (0.3, 0.3, 0.3)), lights=(lamp,)),
    ]
    for world in worlds:
        loss = ShadowBounds(build_scene(world), world).darkest_shadow(())
        assert grey_level_change(loss) == 0.0


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
    assert grey_level_change(ShadowBounds(build_scene(world), world).darkest_shadow(())) == 0.0


def test_shadow_of_a_box_on_a_floor_away_from_all_others_is_found() -> None:
    world = make_world(floor_item(), box_item(0.5, 0.0, -0.15, (0.2, 0.2, 0.3)))
    scene = build_scene(world)
    light = shading.shadow_casting_lights(world.lights)[0]
    shafts = LightShafts(scene, light)
    assert len(shafts) == len(scene)
    names = {scene.item_names[scene.item_index[i]] for i in range(14) if shafts.can_be_hidden(i)}
    assert "floor" in names
