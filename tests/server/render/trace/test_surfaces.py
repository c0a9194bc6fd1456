"""Triangles joined to surfaces, the surfaces' edges, and spheres around all small triangles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.surfaces import (
    BACKGROUND,
    NO_SURFACE,
    find_surfaces,
    uv_planes,
)
from catoptra_server.scene.scene_mesh import SceneMesh, build_scene
from catoptra_server.scene.world_description import (
    Box,
    Cylinder,
    Item,
    Material,
    Rectangle,
    Shape,
    SphereBand,
    World,
)
from helpers.worlds import write_smooth_texture

GREY = Material((0.5, 0.5, 0.5))
AT = Pose.from_rpy((0.3, -0.2, 0.7), (0.4, 0.2, 1.0))


def make_scene(*shapes: Shape, material: Material = GREY) -> SceneMesh:
    items = tuple(Item(f"i{n}", shape, AT, material) for n, shape in enumerate(shapes))
    return build_scene(World("w", items))


def test_box_when_joined_has_six_surfaces_and_twelve_edges() -> None:
    surfaces = find_surfaces(make_scene(Box((1.0, 2.0, 3.0))))
    assert len(surfaces.triangle) == 2 + 6
    lengths = np.linalg.norm(np.diff(surfaces.edges, axis=1)[:, 0], axis=-1)
    np.testing.assert_allclose(np.sort(lengths), np.repeat([1.0, 2.0, 3.0], 4))
    assert sorted(surfaces.of_triangle[:-1]) == sorted([*range(2, 8)] * 2)
    assert surfaces.of_triangle[-1] == BACKGROUND


def test_curved_surface_when_joined_keeps_the_edges_between_its_facets() -> None:
    surfaces = find_surfaces(make_scene(Cylinder(0.5, 1.0)))
    facets = len(surfaces.triangle) - 2 - 2
    assert len(surfaces.edges) == 3 * facets


def test_neighbours_when_of_two_colours_are_two_surfaces() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    albedo = scene.albedo.copy()
    albedo[1] = 0.7
    assert len(find_surfaces(scene).triangle) == 2 + 1
    assert len(find_surfaces(scene).edges) == 4
    painted = find_surfaces(replace(scene, albedo=albedo))
    assert len(painted.triangle) == 2 + 2
    assert len(painted.edges) == 5


@pytest.mark.parametrize(("shift", "count"), [(0.0, 1), (0.25, 2)])
def test_neighbours_when_their_texture_does_not_go_on_are_two_surfaces(
    tmp_path: Path, shift: float, count: int
) -> None:
    material = Material((1.0, 1.0, 1.0), write_smooth_texture(tmp_path / "t.png"))
    scene = make_scene(Rectangle((1.0, 2.0), (3.0, 2.0)), material=material)
    uv = scene.uv.copy()
    uv[1] += shift
    assert len(find_surfaces(replace(scene, uv=uv)).triangle) == 2 + count


def test_uv_of_a_plane_is_that_of_its_corners(tmp_path: Path) -> None:
    material = Material((1.0, 1.0, 1.0), write_smooth_texture(tmp_path / "t.png"))
    scene = make_scene(Box((1.0, 2.0, 3.0)), material=material)
    offset, gradient = uv_planes(scene, np.arange(len(scene)))
    found = np.einsum("nci,nki->nck", scene.corners, gradient) + offset[:, None]
    np.testing.assert_allclose(found, scene.uv, atol=1e-12)


def test_small_triangles_when_many_lie_in_spheres_and_large_ones_do_not() -> None:
    scene = make_scene(SphereBand(0.2, 0.0, 3.1, 80, 40), Rectangle((5.0, 5.0)))
    assert len(scene) > 4000
    surfaces = find_surfaces(scene)
    large = surfaces.of_triangle[:-1] != NO_SURFACE
    assert large[scene.item_index == 1].all()
    small = scene.corners[~large].reshape(-1, 3)
    assert len(small) > 1000
    away = np.linalg.norm(small[:, None] - surfaces.cluster_centre, axis=-1)
    assert (away <= surfaces.cluster_radius_m + 1e-12).any(axis=1).all()
    assert surfaces.cluster_radius_m.max() < 0.2


def test_scene_when_empty_has_no_surface_but_the_background() -> None:
    surfaces = find_surfaces(build_scene(World("w", ())))
    assert surfaces.of_triangle.tolist() == [BACKGROUND]
    assert len(surfaces.edges) == len(surfaces.cluster_centre) == 0
