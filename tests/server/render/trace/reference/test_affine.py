"""Transforms of rays: poses exactly, and entries in between."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.reference.meshes import interpolate_poses

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
