"""Shapes face the right way with upright images; normals and boxes of many triangles are exact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.shapes import (
    Patch,
    bounding_box,
    box,
    build_shape,
    concatenate,
    facet_normals,
    grid,
    smooth_normals,
)
from catoptra_server.world.triangles import ROWS_PER_BLOCK
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Primitive,
    Rectangle,
    Ring,
    SphereBand,
)

CORNERS = np.random.default_rng(1).normal(size=(2 * ROWS_PER_BLOCK + 7, 3, 3))
UNIT_TRIANGLE = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])


def test_normals_of_many_triangles_are_those_of_the_cross_product() -> None:
    normals, has_area = facet_normals(CORNERS)
    cross = np.cross(CORNERS[:, 1] - CORNERS[:, 0], CORNERS[:, 2] - CORNERS[:, 0])
    expected = cross / np.linalg.norm(cross, axis=-1, keepdims=True)
    np.testing.assert_allclose(normals, expected, atol=1e-13)
    assert has_area.all()


@pytest.mark.parametrize("scale", [1e-170, 5e-324, 1e-3, 1.0, 1e150])
def test_normal_does_not_depend_on_the_size(scale: float) -> None:
    normals, has_area = facet_normals(scale * UNIT_TRIANGLE)
    np.testing.assert_array_equal(normals, [[0.0, 0.0, 1.0]])
    assert has_area.all()


@pytest.mark.parametrize(
    "corners",
    [
        [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]],
        [[1.0, 2, 3], [1, 2, 3], [0, 0, 1]],
        [[1.0, 2, 3], [1, 2, 3], [1, 2, 3]],
    ],
    ids=["line", "edge", "point"],
)
def test_triangle_without_area_has_normal_zero(corners: list[list[float]]) -> None:
    normals, has_area = facet_normals(np.array([corners]))
    np.testing.assert_array_equal(normals, 0.0)
    assert not has_area.any()


def test_smooth_normals_are_radial_on_a_wall_and_the_facets_on_ends_and_boxes() -> None:
    cylinder = build_shape(Cylinder(0.5, 0.2, 20)).corners
    facets, _ = facet_normals(cylinder)
    is_wall = np.abs(facets[:, 2]) < 0.5
    smooth = smooth_normals(cylinder, facets)
    radial = cylinder[is_wall] * (2.0, 2.0, 0.0)
    np.testing.assert_allclose(smooth[is_wall], radial, atol=1e-9)
    np.testing.assert_array_equal(smooth[~is_wall], np.repeat(facets[~is_wall, None], 3, axis=1))
    crate = build_shape(Box((1.0, 2.0, 3.0))).corners
    facets, _ = facet_normals(crate)
    assert (smooth_normals(crate, facets) == facets[:, None]).all()


@pytest.mark.parametrize("count", [1, 63, 64, 65, len(CORNERS)])
def test_box_touches_the_extreme_corners(count: int) -> None:
    low, high = bounding_box(CORNERS[:count])
    np.testing.assert_array_equal(low, CORNERS[:count].min(axis=(0, 1)))
    np.testing.assert_array_equal(high, CORNERS[:count].max(axis=(0, 1)))


def test_box_of_no_triangles_is_inverted() -> None:
    low, high = bounding_box(np.zeros((0, 3, 3)))
    np.testing.assert_array_equal(low, np.inf)
    np.testing.assert_array_equal(high, -np.inf)


def area_vectors(patch: Patch) -> Floats:
    """(n, 3) normals whose length is each triangle's area."""
    edges = patch.corners[:, 1:] - patch.corners[:, :1]
    return 0.5 * np.cross(edges[:, 0], edges[:, 1])


def area(patch: Patch) -> float:
    return float(np.linalg.norm(area_vectors(patch), axis=-1).sum())


def volume(patch: Patch) -> float:
    """Volume inside a closed patch; negative for one inside out."""
    middles = patch.corners.mean(axis=1)
    return float(np.einsum("ij,ij->", area_vectors(patch), middles)) / 3.0


def assert_texture_is_upright(patch: Patch) -> None:
    """Assert that u runs right and v down on each triangle, seen from the lit side."""
    edges = patch.corners[:, 1:] - patch.corners[:, :1]
    steps = patch.uv[:, 1:] - patch.uv[:, :1]
    # edges = steps @ (dP/du, dP/dv)
    per_u, per_v = np.moveaxis(np.linalg.solve(steps, edges), 1, 0)
    into = np.einsum("ij,ij->i", np.cross(per_u, per_v), area_vectors(patch))
    assert (into < 0.0).all()


SOLIDS = {
    "box": (box(Box((1.0, 2.0, 3.0))), 6.0, 22.0),
    "cylinder": (
        build_shape(Cylinder(0.5, 2.0, sectors=480)),
        math.pi * 0.25 * 2.0,
        math.pi * (2.0 + 0.5),
    ),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solid_is_closed_and_faces_outwards(name: str) -> None:
    patch, _, _ = SOLIDS[name]
    np.testing.assert_allclose(area_vectors(patch).sum(axis=0), 0.0, atol=1e-12)
    outward = np.einsum("ij,ij->i", area_vectors(patch), patch.corners.mean(axis=1))
    assert (outward > 0.0).all()


@pytest.mark.parametrize("name", SOLIDS)
def test_solid_has_its_volume_and_area(name: str) -> None:
    patch, cubic_metres, square_metres = SOLIDS[name]
    # 480 facets miss a circle's area by (2 pi / 480)^2 / 6.
    assert volume(patch) == pytest.approx(cubic_metres, rel=1e-4)
    assert area(patch) == pytest.approx(square_metres, rel=1e-4)


def test_box_when_textured_shows_the_image_once_and_unmirrored_on_each_side() -> None:
    patch = box(Box((1.0, 2.0, 3.0)))
    assert_texture_is_upright(patch)
    for side in patch.uv.reshape(6, 6, 2):
        assert {tuple(corner) for corner in side} == {(0, 0), (0, 1), (1, 0), (1, 1)}


BAND = SphereBand(2.0, 0.3, 2.0, 64, 16, is_solid=True)
TILED = [
    Box((1.0, 2.0, 3.0)),
    Rectangle((3.0, 2.0)),
    Cylinder(0.5, 2.0),
    Ring(0.5, 2.0),
    BAND,
    replace(BAND, is_solid=False),
]


@pytest.mark.parametrize("shape", TILED, ids=lambda shape: type(shape).__name__)
def test_tiles_have_their_metres_upright_on_each_face(shape: Primitive) -> None:
    patch = build_shape(shape, 0.25)
    assert_texture_is_upright(patch)
    edges = patch.corners[:, 1:] - patch.corners[:, :1]
    steps = patch.uv[:, 1:] - patch.uv[:, :1]
    per_tile = np.linalg.norm(np.linalg.solve(steps, edges), axis=-1)
    # Whole tiles close a circle: half of one in 12; and parallels shrink towards the poles.
    is_closed = isinstance(shape, Cylinder | SphereBand)
    assert per_tile.max() == pytest.approx(0.25, rel=0.05 if is_closed else 1e-9)
    if not isinstance(shape, SphereBand):
        assert per_tile.min() == pytest.approx(0.25, rel=0.05 if is_closed else 1e-9)


def test_box_when_tiled_begins_with_a_whole_tile_at_its_foot() -> None:
    patch = build_shape(Box((1.0, 2.0, 3.0)), 0.7)
    sides = np.abs(patch.corners[..., 2].max(axis=1) - patch.corners[..., 2].min(axis=1)) > 0.0
    at_foot = patch.corners[..., 2] == 1.5
    np.testing.assert_allclose(patch.uv[sides][at_foot[sides]][:, 1], 0.0)


@pytest.mark.parametrize("is_solid", [True, False])
def test_band_when_textured_shows_the_image_once(is_solid: bool) -> None:
    patch = build_shape(replace(BAND, is_solid=is_solid))
    assert_texture_is_upright(patch)
    np.testing.assert_allclose(patch.uv.min(axis=(0, 1)), 0.0, atol=1e-12)
    np.testing.assert_allclose(patch.uv.max(axis=(0, 1)), 1.0, atol=1e-12)


def test_box_when_textured_has_upright_images() -> None:
    patch = box(Box((1.0, 2.0, 3.0)))
    upright = np.abs(area_vectors(patch)[:, 2]) < 1e-12
    low = patch.corners[upright][..., 2] > 0.0
    np.testing.assert_array_equal(patch.uv[upright][..., 1], low)


def test_cylinder_when_textured_has_the_image_once_around_unmirrored() -> None:
    patch = build_shape(Cylinder(0.5, 2.0, sectors=12))
    side = np.abs(area_vectors(patch)[:, 2]) < 1e-12
    wall = Patch(patch.corners[side], patch.uv[side])
    assert len(wall.corners) == 24
    assert_texture_is_upright(wall)
    assert (wall.uv.min(), wall.uv.max()) == (0.0, 1.0)


def test_rectangle_faces_up_and_repeats_its_image() -> None:
    patch = build_shape(Rectangle((2.0, 3.0), texture_repeat=(4.0, 5.0)))
    assert area(patch) == pytest.approx(6.0)
    np.testing.assert_allclose(area_vectors(patch).sum(axis=0), (0.0, 0.0, -6.0), atol=1e-12)
    assert patch.uv.max(axis=(0, 1)).tolist() == [4.0, 5.0]
    assert_texture_is_upright(patch)


def test_rectangle_when_textured_has_the_top_of_the_image_ahead() -> None:
    patch = build_shape(Rectangle((2.0, 3.0)))
    np.testing.assert_array_equal(patch.uv[..., 1] == 0.0, patch.corners[..., 0] > 0.0)
    np.testing.assert_array_equal(patch.uv[..., 0] == 0.0, patch.corners[..., 1] < 0.0)


@pytest.mark.parametrize("inner", [0.0, 0.4])
def test_ring_faces_up_with_its_area(inner: float) -> None:
    patch = build_shape(Ring(inner, 0.5, sectors=400))
    up = area_vectors(patch).sum(axis=0)
    assert -up[2] == pytest.approx(math.pi * (0.25 - inner**2), rel=1e-4)
    assert (np.linalg.norm(area_vectors(patch), axis=-1) > 0.0).all()


@pytest.mark.parametrize(
    ("from_deg", "to_deg"), [(0.0, 180.0), (89.0, 91.0), (0.0, 30.0), (150.0, 180.0)]
)
def test_sphere_band_faces_inwards_with_its_area(from_deg: float, to_deg: float) -> None:
    lower, upper = math.radians(from_deg), math.radians(to_deg)
    patch = build_shape(SphereBand(2.0, lower, upper, sectors=300, rings=100))
    zone = 2.0 * math.pi * 4.0 * (math.cos(lower) - math.cos(upper))
    assert area(patch) == pytest.approx(zone, rel=1e-3)
    inward = np.einsum("ij,ij->i", area_vectors(patch), patch.corners.mean(axis=1))
    assert (inward < 0.0).all()


def test_sphere_band_starts_at_the_lower_pole() -> None:
    patch = build_shape(SphereBand(2.0, 0.0, math.radians(10.0), rings=3))
    assert (patch.corners[..., 2] > 1.9).all()


def test_grid_with_a_pole_has_no_degenerate_triangles() -> None:
    points = np.array([[[0.0, 0, 0], [0, 0, 0]], [[0, 1, 0], [1, 1, 0]]])
    assert len(grid(points, np.zeros((2, 2, 2))).corners) == 1


def test_concatenated_and_translated_patches_keep_their_triangles() -> None:
    flat = build_shape(Rectangle((1.0, 1.0)))
    both = concatenate([flat, flat.translate((0.0, 0.0, 5.0))])
    assert len(both.corners) == 4
    assert both.corners[2:, :, 2].tolist() == 2 * [[5.0, 5.0, 5.0]]
