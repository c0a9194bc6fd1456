"""Triangles joined to flat surfaces, their outer edges, and spheres around small triangles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel import scene_arrays as flat_surfaces
from catoptra_server.render.trace.kernel.scene_arrays import (
    FlatSurfaces,
    find_flat_surfaces,
    has_corner_colours,
    uv_planes,
)
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Item,
    Material,
    Rectangle,
    Ring,
    Shape,
    SphereBand,
    World,
)
from helpers.worlds import write_smooth_texture

GREY = Material((0.5, 0.5, 0.5))
AT = Pose.from_rpy((0.3, -0.2, 0.7), (0.4, 0.2, 1.0))


def make_scene(*shapes: Shape, material: Material = GREY) -> SceneMesh:
    """Shapes of one material at one pose."""
    items = tuple(Item(f"i{n}", shape, AT, material) for n, shape in enumerate(shapes))
    return build_scene(World("w", items))


def outer_edge_lengths(scene: SceneMesh, surfaces: FlatSurfaces) -> list[float]:
    """Lengths of the outer edges of all surfaces, sorted."""
    corners = scene.corners[surfaces.triangles]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)
    is_outer = surfaces.outer_edges[:, None] >> np.arange(3) & 1
    return sorted(lengths[is_outer.astype(bool)].tolist())


def test_box_has_six_surfaces_that_its_twelve_edges_bound_on_both_sides() -> None:
    scene = make_scene(Box((1.0, 2.0, 3.0)))
    surfaces = find_flat_surfaces(scene)
    assert len(surfaces.representative) == 6
    assert np.bincount(surfaces.surface).tolist() == [2] * 6
    np.testing.assert_allclose(outer_edge_lengths(scene, surfaces), np.repeat([1.0, 2.0, 3.0], 8))


def test_representative_of_a_surface_is_its_largest_triangle() -> None:
    scene = make_scene(Rectangle((2.0, 2.0)), Cylinder(0.5, 1.0))
    surfaces = find_flat_surfaces(scene)
    cross = np.cross(
        scene.corners[:, 1] - scene.corners[:, 0], scene.corners[:, 2] - scene.corners[:, 0]
    )
    area = 0.5 * np.linalg.norm(cross, axis=-1)
    for number, triangle in enumerate(surfaces.representative):
        members = surfaces.triangles[surfaces.surface == number]
        assert triangle in members
        assert area[triangle] == pytest.approx(area[members].max())


def test_edges_between_facets_of_a_curved_surface_are_outer() -> None:
    surfaces = find_flat_surfaces(make_scene(SphereBand(0.5, 0.1, 3.0, 9, 4)))
    quads = len(surfaces.representative)
    assert quads == 9 * 4
    # Of each quad's two triangles only the diagonal is inside.
    assert [mask.bit_count() for mask in surfaces.outer_edges.tolist()] == [2] * (2 * quads)


def test_ring_is_one_surface_with_outer_edges_along_both_circles() -> None:
    scene = make_scene(Ring(0.5, 1.0, sectors=12))
    surfaces = find_flat_surfaces(scene)
    assert len(surfaces.representative) == 1
    chord = 2.0 * np.sin(np.pi / 12.0)
    expected = np.repeat([0.5 * chord, chord], 12)
    np.testing.assert_allclose(outer_edge_lengths(scene, surfaces), expected)


def test_neighbours_when_of_two_colours_are_two_surfaces() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    albedo = scene.albedo.copy()
    albedo[1] = 0.7
    assert find_flat_surfaces(scene).surface.tolist() == [0, 0]
    assert sum(m.bit_count() for m in find_flat_surfaces(scene).outer_edges.tolist()) == 4
    painted = find_flat_surfaces(replace(scene, albedo=albedo))
    assert painted.surface.tolist() == [0, 1]
    assert painted.outer_edges.tolist() == [7, 7]


def test_neighbours_when_one_is_unlit_are_two_surfaces() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    surfaces = find_flat_surfaces(replace(scene, unlit=np.array([True, False])))
    assert surfaces.surface.tolist() == [0, 1]


def test_triangles_whose_colour_varies_are_surfaces_of_their_own() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)), Rectangle((2.0, 2.0)))
    colours = np.full((4, 3, 3), 0.5)
    colours[:2, 0] = 0.8
    coloured = replace(scene, corner_albedo=colours)
    assert has_corner_colours(coloured).tolist() == [True, True, False, False]
    assert not has_corner_colours(scene).any()
    assert find_flat_surfaces(coloured).surface.tolist() == [0, 1, 2, 2]


@pytest.mark.parametrize(("shift", "count"), [(0.0, 1), (0.25, 2)])
def test_neighbours_when_their_texture_does_not_go_on_are_two_surfaces(
    tmp_path: Path, shift: float, count: int
) -> None:
    material = Material((1.0, 1.0, 1.0), write_smooth_texture(tmp_path / "t.png"))
    scene = make_scene(Rectangle((1.0, 2.0), (3.0, 2.0)), material=material)
    uv = scene.uv.copy()
    uv[1] += shift
    assert len(find_flat_surfaces(replace(scene, uv=uv)).representative) == count


def test_uv_of_a_plane_is_that_of_its_corners(tmp_path: Path) -> None:
    material = Material((1.0, 1.0, 1.0), write_smooth_texture(tmp_path / "t.png"))
    scene = make_scene(Box((1.0, 2.0, 3.0)), material=material)
    offset, gradient = uv_planes(scene, np.arange(len(scene)))
    found = np.einsum("nci,nki->nck", scene.corners, gradient) + offset[:, None]
    np.testing.assert_allclose(found, scene.uv, atol=1e-12)


def test_triangles_when_they_occur_twice_keep_their_outer_edges() -> None:
    # Both lie on the same side of each shared edge: nothing continues beyond it.
    scene = make_scene(Rectangle((1.0, 2.0)), Rectangle((1.0, 2.0)))
    surfaces = find_flat_surfaces(scene)
    assert outer_edge_lengths(scene, surfaces)[-4:] == pytest.approx([5.0**0.5] * 4)
    assert len(outer_edge_lengths(scene, surfaces)) == 12


def test_edge_when_three_triangles_share_it_is_outer() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    rows = [0, 1, 0]
    tripled = replace(
        scene,
        corners=scene.corners[rows],
        normals=scene.normals[rows],
        uv=scene.uv[rows],
        albedo=scene.albedo[rows],
        unlit=scene.unlit[rows],
        texture_index=scene.texture_index[rows],
        item_index=scene.item_index[rows],
        casts_shadows=scene.casts_shadows[rows],
        object_index=scene.object_index[rows],
    )
    assert find_flat_surfaces(tripled).outer_edges.tolist() == [7, 7, 7]


def test_triangle_without_area_is_joined_to_none() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    corners = scene.corners.copy()
    corners[1, 2] = corners[1, 1]
    normals = scene.normals.copy()
    normals[1] = 0.0
    surfaces = find_flat_surfaces(replace(scene, corners=corners, normals=normals))
    assert surfaces.surface.tolist() == [0, 1]
    assert surfaces.outer_edges[0] == 7


def test_small_triangles_when_many_lie_in_spheres_and_large_ones_do_not() -> None:
    scene = make_scene(SphereBand(0.2, 0.0, 3.1, 80, 40), Rectangle((5.0, 5.0)))
    assert len(scene) > 4000
    surfaces = find_flat_surfaces(scene)
    is_large = np.isin(np.arange(len(scene)), surfaces.triangles)
    assert is_large[scene.item_index == 1].all()
    assert 0 < len(surfaces.triangles) <= 4000
    small = scene.corners[~is_large]
    assert len(small) > 1000
    centres, radii = surfaces.clusters[:, :3], surfaces.clusters[:, 3]
    aside = np.linalg.norm(small[:, :, None] - centres, axis=-1)
    # Some sphere holds all corners of each, and with them the whole triangle.
    assert (aside <= radii + 1e-12).all(axis=1).any(axis=1).all()
    assert len(centres) <= 500
    assert radii.max() < 0.2


def test_scene_when_empty_or_too_large_has_no_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_scene(Box((1.0, 1.0, 1.0)))
    monkeypatch.setattr(flat_surfaces, "MAX_TRIANGLES", 12)
    assert len(find_flat_surfaces(scene).representative) == 6
    monkeypatch.setattr(flat_surfaces, "MAX_TRIANGLES", 11)
    for none in (scene, build_scene(World("w", ()))):
        surfaces = find_flat_surfaces(none)
        assert len(surfaces.triangles) == len(surfaces.representative) == 0
        assert surfaces.clusters.shape == (0, 4)
