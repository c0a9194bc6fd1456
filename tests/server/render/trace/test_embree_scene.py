"""Hits of single rays, and the radiance of the surfaces hit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import SrgbScale
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import (
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    World,
)
from helpers.mesh_file_samples import make_quadrant_image

SCALE = SrgbScale.for_samples(1)
SKY = HemisphereLight((0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
DOWN = (0.0, 0.0, 1.0)


def make_floor_world(material: Material, *lights: Light) -> World:
    """A floor of 2 x 2 m, 1 m below the origin, under a blue background."""
    floor = Item("floor", Rectangle((2.0, 2.0)), Pose.from_rpy((0.0, 0.0, 1.0)), material)
    return World("w", (floor,), lights=lights, background=(0.0, 0.0, 1.0))


def trace_colours(
    world: World, *rays: tuple[tuple[float, float, float], tuple[float, float, float]]
) -> list[list[int]]:
    """Colours of rays (origin, direction)."""
    scene = EmbreeScene(build_scene(world), world)
    origins = np.array([origin for origin, _ in rays]) - scene.origin
    directions = np.array([direction for _, direction in rays])
    light = scene.trace_radiance(
        origins.astype(np.float32),
        directions.astype(np.float32),
        table=scene.radiance_table(SCALE),
        scale=SCALE,
    )
    found: list[list[int]] = SCALE.unpack(light).tolist()
    return found


def test_ray_has_the_radiance_of_the_surface_hit_or_the_background() -> None:
    world = make_floor_world(Material((1.0, 0.0, 0.0)), SKY)
    rays = [((0, 0, 0), DOWN), ((5, 0, 0), DOWN), ((0, 0, 0), (0.0, 0.0, -1.0))]
    assert trace_colours(world, *rays) == [[188, 0, 0], [0, 0, 255], [0, 0, 255]]


def test_surface_when_unlit_shows_its_albedo_under_any_light() -> None:
    point_light = PointLight((0.0, 0.0, 0.0), (9.0, 9.0, 9.0))
    world = make_floor_world(Material((0.5, 0.0, 0.0), unlit=True), SKY, point_light)
    assert trace_colours(world, ((0, 0, 0), DOWN)) == [[188, 0, 0]]


def test_point_light_when_above_lights_by_the_position_of_the_hit() -> None:
    point_light = PointLight((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    world = make_floor_world(Material((0.5, 0.5, 0.5)), point_light)
    centre, aside = trace_colours(world, ((0, 0, 0), DOWN), ((1 - 1e-3, 0, 0), DOWN))
    assert centre == [188, 188, 188]
    # 0.5 / 2 * cos 45 degrees = 0.1768 of full light.
    assert aside == [117, 117, 117]


@pytest.mark.parametrize(
    ("x", "y", "colour"),
    [
        (0.5, -0.5, [255, 0, 0]),  # ahead on the left: the image's top left
        (0.5, 0.5, [0, 255, 0]),
        (-0.5, -0.5, [0, 0, 255]),
        (-0.5, 0.5, [255, 255, 255]),
    ],
)
def test_texture_on_the_floor_is_upright_from_above(
    tmp_path: Path, x: float, y: float, colour: list[int]
) -> None:
    make_quadrant_image().save(tmp_path / "q.png")
    image = Material((1.0, 1.0, 1.0), texture=tmp_path / "q.png", unlit=True)
    assert trace_colours(make_floor_world(image), ((x, y, 0), DOWN)) == [colour]


def test_scene_when_it_has_no_triangles_is_all_background() -> None:
    world = World("w", (), background=(1.0, 1.0, 1.0))
    assert trace_colours(world, ((0, 0, 0), DOWN), ((1e5, 0, 0), DOWN)) == 2 * [[255, 255, 255]]


def test_surface_from_behind_is_visible_too() -> None:
    world = make_floor_world(Material((1.0, 0.0, 0.0), unlit=True))
    assert trace_colours(world, ((0, 0, 5), (0.0, 0.0, -1.0))) == [[255, 0, 0]]
