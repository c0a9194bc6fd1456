"""Transforms of rays, first hits of several meshes, and materials at hits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.reference.meshes import (
    FirstHits,
    PlacedMesh,
    WorldRays,
    find_first_hits,
    interpolate_poses,
    trace_object,
    trace_scene,
)
from catoptra_server.render.trace.trace_engine import NOTHING
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shading import sample_texture
from catoptra_server.world.world_description import linear_from_srgb
from helpers.dynamic_objects import build_cube_mesh
from helpers.shadows import box_item, floor_item, make_world
from helpers.worlds import make_test_world, write_smooth_texture

FIRST = Pose.from_rpy((1.0, 2.0, 3.0), (0.1, -0.2, 0.5))
SECOND = Pose.from_rpy((2.0, 2.0, 1.0), (0.3, 0.2, 0.1))
THIRD = Pose.from_rpy((0.0, -2.0, 1.0), (0.0, 0.2, -0.3))
POINTS = np.random.default_rng(1).normal(size=(5, 3))
TIMES = np.array((0.0, 0.3, 0.5, 0.9, 1.0))


@pytest.mark.parametrize("times", [None, TIMES])
def test_transform_of_one_pose_is_the_pose(times: np.ndarray | None) -> None:
    transform = interpolate_poses((FIRST,), times)
    np.testing.assert_allclose(transform.points(POINTS), FIRST.transform_points(POINTS))
    np.testing.assert_allclose(transform.vectors(POINTS), FIRST.rotate_directions(POINTS))


def test_transform_without_times_is_the_first_pose() -> None:
    transform = interpolate_poses((FIRST, SECOND), None)
    np.testing.assert_allclose(transform.points(POINTS), FIRST.transform_points(POINTS))


def test_transforms_at_the_poses_times_are_the_poses() -> None:
    transform = interpolate_poses((FIRST, SECOND, THIRD), np.array((0.0, 0.5, 1.0)))
    for index, pose in enumerate((FIRST, SECOND, THIRD)):
        np.testing.assert_allclose(transform.matrix[index], pose.rotation)
        np.testing.assert_allclose(transform.offset[index], pose.translation)


def test_transforms_between_two_poses_have_entries_between_theirs() -> None:
    transform = interpolate_poses((FIRST, SECOND, THIRD), np.array((0.25, 0.9)))
    np.testing.assert_allclose(transform.matrix[0], 0.5 * (FIRST.rotation + SECOND.rotation))
    np.testing.assert_allclose(
        transform.offset[1], 0.2 * SECOND.translation + 0.8 * THIRD.translation
    )


@pytest.mark.parametrize("times", [None, TIMES])
def test_inverse_undoes_the_transform(times: np.ndarray | None) -> None:
    transform = interpolate_poses((FIRST, SECOND), times)
    np.testing.assert_allclose(transform.inverse_points(transform.points(POINTS)), POINTS)
    np.testing.assert_allclose(transform.inverse_vectors(transform.vectors(POINTS)), POINTS)


def test_normals_stay_perpendicular_to_transformed_surfaces_and_unit() -> None:
    transform = interpolate_poses((FIRST, SECOND), TIMES)
    along = np.cross(POINTS, (0.3, 0.5, -0.7))
    normals = transform.normals(POINTS)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0)
    products = np.einsum("ni,ni->n", normals, transform.vectors(along))
    np.testing.assert_allclose(products, 0.0, atol=1e-12)


def test_normal_of_a_triangle_without_area_stays_zero() -> None:
    assert not interpolate_poses((FIRST,), None).normals(np.zeros((2, 3))).any()


@pytest.mark.parametrize("times", [None, TIMES])
def test_transforms_of_some_rays_are_those_of_all(times: np.ndarray | None) -> None:
    transform, some = interpolate_poses((FIRST, SECOND), times), np.array((3, 1))
    np.testing.assert_array_equal(
        transform.take(some).points(POINTS[some]), transform.points(POINTS)[some]
    )


AHEAD_PLACED_MESH = np.array([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
RAYS_AHEAD = WorldRays(np.zeros((2, 3)), AHEAD_PLACED_MESH, np.zeros((2, 2, 3)))


def place_cubes(*poses: Pose) -> list[PlacedMesh]:
    mesh = trace_object(build_cube_mesh(0.4), ())
    return [PlacedMesh(mesh, interpolate_poses((pose,), None)) for pose in poses]


def make_hits(triangle: npt.NDArray[np.int32], weights: Floats) -> tuple[FirstHits, WorldRays]:
    """Hits on the first mesh by rays from above, whose neighbours are the same rays."""
    count = len(triangle)
    down = np.tile((0.0, 0.0, 1.0), (count, 1))
    hits = FirstHits(np.ones(count), np.zeros(count, dtype=np.int32), triangle, weights)
    return hits, WorldRays(np.zeros((count, 3)), down, np.zeros((count, 2, 3)))


def test_first_hit_is_the_nearest_of_all_meshes() -> None:
    cubes = place_cubes(*(Pose.from_rpy((x, 0.0, 0.0)) for x in (3.0, 2.0, 4.0)))
    hits = find_first_hits(cubes, RAYS_AHEAD)
    assert hits.object.tolist() == [1, NOTHING]
    assert hits.triangle[1] == NOTHING
    np.testing.assert_allclose(hits.distance, (1.8, np.inf))


def test_first_hit_of_meshes_at_one_place_is_the_earlier_one_s() -> None:
    cubes = place_cubes(*[Pose.from_rpy((3.0, 0.0, 0.0))] * 2)
    assert find_first_hits(cubes, RAYS_AHEAD).object[0] == 0


def test_albedo_of_a_textured_mesh_is_that_of_the_shading_model(tmp_path) -> None:  # type: ignore[no-untyped-def]
    scene = build_scene(make_test_world(texture=write_smooth_texture(tmp_path / "waves.png")))
    mesh = trace_scene(scene, np.zeros(3), ())
    triangle = np.arange(len(scene), dtype=np.int32)
    weights = np.random.default_rng(2).dirichlet((1.0, 1.0, 1.0), len(scene))[:, 1:]
    found = mesh.albedo_at(*make_hits(triangle, weights))
    textured = scene.texture_index >= 0
    np.testing.assert_array_equal(found[~textured], scene.albedo[~textured])
    uv = scene.uv[:, 0] + np.einsum("nc,nci->ni", weights, scene.uv[:, 1:] - scene.uv[:, :1])
    texels = sample_texture(linear_from_srgb(scene.textures[0] / 255.0), uv[textured])
    # The mesh keeps its texels in float32.
    np.testing.assert_allclose(found[textured], scene.albedo[textured] * texels, rtol=1e-6)
    assert 0 < textured.sum() < len(scene)


def test_albedo_of_a_mesh_with_colours_at_its_corners_lies_between_them() -> None:
    scene = build_scene(make_world(floor_item()))
    colours = np.random.default_rng(3).uniform(size=(len(scene), 3, 3))
    mesh = trace_scene(replace(scene, corner_albedo=colours), np.zeros(3), ())
    hits = make_hits(np.array((0, 1), dtype=np.int32), np.array(((0.2, 0.5), (1.0, 0.0))))
    expected = 0.3 * colours[0, 0] + 0.2 * colours[0, 1] + 0.5 * colours[0, 2], colours[1, 1]
    np.testing.assert_allclose(mesh.albedo_at(*hits), expected)


def test_triangles_that_cast_no_shadow_are_seen_but_occlude_nothing() -> None:
    glass = replace(box_item(3.0, 0.0, 0.0, (0.4, 0.4, 0.4)), casts_shadows=False)
    mesh = trace_scene(build_scene(make_world(glass)), np.zeros(3), ())
    assert mesh.surface.first_hits(np.zeros((2, 3)), AHEAD_PLACED_MESH)[1][0] >= 0
    assert not mesh.casters.occludes(np.zeros((2, 3)), AHEAD_PLACED_MESH, np.full(2, np.inf)).any()
