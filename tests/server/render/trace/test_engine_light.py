"""What a ray shows, for each engine: surfaces, lights, textures, background.

Rows of single rays in small worlds, whose light follows by hand.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.ray_table import face_ray_table
from catoptra_server.render.trace.trace_engine import NOTHING
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    MeshFile,
    PointLight,
    Rectangle,
    World,
)
from helpers.mesh_file_samples import make_quadrant_image, write_textured_gltf
from helpers.trace_engines import (
    AT_ORIGIN,
    ENGINES,
    encode_rays,
    make_row_table,
    open_engine,
    render_rays,
)

pytestmark = pytest.mark.parametrize("engine", ENGINES)

SKY = HemisphereLight((0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
NOON = DirectionalLight((0.0, 0.0, 1.0), (0.5, 0.5, 0.5))
WHITE = Material((1.0, 1.0, 1.0), unlit=True)
DOWN, UP, AHEAD = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)


def make_floor(material: Material, *lights: Light) -> World:
    """A floor of 2 x 2 m, 1 m below the origin, under a blue background."""
    floor = Item("floor", Rectangle((2.0, 2.0)), Pose.from_rpy((0.0, 0.0, 1.0)), material)
    return World("w", (floor,), lights=lights, background=(0.0, 0.0, 1.0))


def test_ray_has_the_radiance_of_the_surface_hit_or_the_background(engine: EngineName) -> None:
    world = make_floor(Material((1.0, 0.0, 0.0)), SKY)
    rays = [((0, 0, 0), DOWN), ((5, 0, 0), DOWN), ((0, 0, 0), UP)]
    assert encode_rays(engine, world, *rays) == [[188, 0, 0], [0, 0, 255], [0, 0, 255]]


def test_surface_when_unlit_shows_its_albedo_under_any_light(engine: EngineName) -> None:
    lamp = PointLight((0.0, 0.0, 0.0), (9.0, 9.0, 9.0))
    world = make_floor(Material((0.5, 0.0, 0.0), unlit=True), SKY, lamp)
    assert encode_rays(engine, world, ((0, 0, 0), DOWN)) == [[188, 0, 0]]


def test_point_light_when_above_lights_by_the_position_of_the_hit(engine: EngineName) -> None:
    lamp = PointLight((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    rays = ((0, 0, 0), DOWN), ((1 - 1e-3, 0, 0), DOWN)
    centre, aside = encode_rays(engine, make_floor(Material((0.5, 0.5, 0.5)), lamp), *rays)
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
    engine: EngineName, tmp_path: Path, x: float, y: float, colour: list[int]
) -> None:
    make_quadrant_image().save(tmp_path / "q.png")
    image = Material((1.0, 1.0, 1.0), texture=tmp_path / "q.png", unlit=True)
    assert encode_rays(engine, make_floor(image), ((x, y, 0), DOWN)) == [colour]


def test_placements_that_share_texture_coordinates_look_as_if_each_had_its_own(
    engine: EngineName, tmp_path: Path
) -> None:
    square = MeshFile(write_textured_gltf(tmp_path))
    # Aslant, the last one mirrored: its coordinates are shared by no other.
    scales = [(1.0, 1.0, 1.0)] * 8 + [(-1.0, 1.0, 1.0)]
    items = [
        Item(f"i{n}", square, Pose.from_rpy((n, 0, 1), (0.1, 0, 0)), None, unlit=True, scale=scale)
        for n, scale in enumerate(scales)
    ]
    world = World("w", tuple(items))
    scene = build_scene(world)
    assert len(scene.uv) == 4
    alone = replace(scene, uv=scene.corner_uv, uv_rows=None)
    rng = np.random.default_rng(7)
    triangle = rng.integers(0, len(scene), 999)
    points = np.einsum("rc,rci->ri", rng.dirichlet((1, 1, 1), 999), scene.corners[triangle])
    rays = -scene.normals[triangle], points + 0.01 * scene.normals[triangle]
    shared = render_rays(engine, world, *rays, scene=scene)
    assert len(np.unique(shared.round(2), axis=0)) > 4
    np.testing.assert_array_equal(shared, render_rays(engine, world, *rays, scene=alone))


def test_colours_of_corners_are_interpolated_over_a_triangle(engine: EngineName) -> None:
    world = make_floor(WHITE)
    scene = build_scene(world)
    # Red grows with x from 0 to 1, green is even, blue grows with y.
    colours = np.stack((0.5 + 0.5 * scene.corners[..., 0], 0.3 + 0.0 * scene.uv[..., 0]), axis=-1)
    colours = np.concatenate((colours, 0.5 + 0.5 * scene.corners[..., 1:2]), axis=-1)
    origins = np.array([(0.2, 0.4, 0.0), (-0.6, 0.8, 0.0), (0.9, -0.9, 0.0)])
    seen = render_rays(
        engine, world, np.tile(DOWN, (3, 1)), origins, scene=replace(scene, corner_albedo=colours)
    )
    expected = np.stack((0.5 + 0.5 * origins[:, 0], [0.3] * 3, 0.5 + 0.5 * origins[:, 1]), axis=-1)
    np.testing.assert_allclose(seen, expected, atol=2e-6)


def test_scene_when_it_has_no_triangles_is_all_background(engine: EngineName) -> None:
    world = World("w", (), background=(1.0, 1.0, 1.0))
    rays = ((0, 0, 0), DOWN), ((1e5, 0, 0), DOWN)
    assert encode_rays(engine, world, *rays) == 2 * [[255, 255, 255]]


def test_surface_from_behind_is_visible_and_dark_unless_unlit(engine: EngineName) -> None:
    from_below = ((0, 0, 5), UP)
    unlit = make_floor(Material((1.0, 0.0, 0.0), unlit=True))
    assert encode_rays(engine, unlit, from_below) == [[255, 0, 0]]
    lit = make_floor(Material((1.0, 0.0, 0.0)), NOON)
    assert encode_rays(engine, lit, from_below, ((0, 0, 0), DOWN)) == [[188, 0, 0]] * 2
    away = make_floor(Material((1.0, 0.0, 0.0)), replace(NOON, direction=(0.0, 0.0, -1.0)))
    assert encode_rays(engine, away, ((0, 0, 0), DOWN)) == [[0, 0, 0]]


def test_light_brighter_than_white_is_clipped_once_behind_the_mean(engine: EngineName) -> None:
    # A panel of 1.2 times white fills the right half of the one pixel.
    panel = Item("panel", Box((0.1, 2.0, 4.0)), Pose.from_rpy((1.0, 1.0, 0.0)), Material((1, 1, 1)))
    bright = HemisphereLight((1.2, 1.2, 1.2), (1.2, 1.2, 1.2))
    with open_engine(engine, World("w", (panel,), lights=(bright,))) as opened:
        rays = opened.prepare(face_ray_table(FaceCamera(Face.N, 1), 4))
        # The grey of 0.6; of white on one half it would be 188.
        assert rays.render_srgb(AT_ORIGIN).tolist() == [[[203, 203, 203]]]
        np.testing.assert_allclose(rays.render_linear(AT_ORIGIN), 0.6, rtol=1e-6)


def test_rays_that_are_invalid_are_black_and_meet_nothing(engine: EngineName) -> None:
    with open_engine(engine, make_floor(WHITE)) as opened:
        table = make_row_table(np.tile(DOWN, (3, 1)))
        rays = opened.prepare(replace(table, valid=np.array([[0b101]], dtype=np.uint16)))
        assert rays.render_srgb(AT_ORIGIN)[0, :, 0].tolist() == [255, 0, 255]
        assert rays.render_linear(AT_ORIGIN)[0, :, 0].tolist() == [1.0, 0.0, 1.0]
        hits = rays.find_hits(AT_ORIGIN)
    assert hits.range_m[0, 0, :4].tolist() == [1.0, np.inf, 1.0, np.inf]
    assert hits.triangle[0, 0, 1:2].tolist() == hits.object[0, 0, 3:4].tolist() == [NOTHING]
