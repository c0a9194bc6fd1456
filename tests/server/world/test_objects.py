"""Rays and boxes: from all sides, rotated, from inside, misses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world import shapes as primitives
from catoptra_server.world.objects import (
    DynamicObject,
    OrientedBox,
    box_distances,
    build_object_mesh,
    closest_box_hits,
    world_facets,
)
from catoptra_server.world.world_description import Box, Material

BOX = OrientedBox(Pose.from_rpy((2.0, 0.0, 0.0)), (1.0, 2.0, 0.5))


def distance(box: OrientedBox, origin: object, direction: object) -> float:
    return float(box_distances([box], np.array([origin], float), np.array([direction], float))[0])


@pytest.mark.parametrize(
    ("origin", "direction", "expected"),
    [
        ((0, 0, 0), (1, 0, 0), 1.5),
        ((5, 0, 0), (-1, 0, 0), 2.5),
        ((2, 5, 0), (0, -1, 0), 4.0),
        ((2, 0, -3), (0, 0, 1), 2.75),
        ((0, 0, 0), (-1, 0, 0), math.inf),
        ((0, 1.1, 0), (1, 0, 0), math.inf),
        ((2, 0, 0), (1, 0, 0), 0.0),
        ((0, 0, 0), (0.8, 0.6, 0), math.inf),
    ],
)
def test_distance_from_a_side_is_to_that_face(
    origin: object, direction: object, expected: float
) -> None:
    assert distance(BOX, origin, direction) == pytest.approx(expected)


def test_distance_to_a_box_at_45_degrees_is_to_the_corner() -> None:
    box = OrientedBox(Pose.from_rpy((2.0, 0.0, 0.0), (0.0, 0.0, math.pi / 4)), (1.0, 1.0, 1.0))
    assert distance(box, (0, 0, 0), (1, 0, 0)) == pytest.approx(2.0 - math.sqrt(0.5))


def test_distance_to_several_boxes_is_to_the_nearest() -> None:
    far = OrientedBox(Pose.from_rpy((5.0, 0.0, 0.0)), (1.0, 1.0, 1.0))
    one_ray = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]])
    assert box_distances([far, BOX], *one_ray)[0] == 1.5
    assert np.isinf(box_distances([], *one_ray))


def test_hits_have_the_normal_of_the_entered_face() -> None:
    box = OrientedBox(Pose.from_rpy((2.0, 0.0, 0.0), (0.0, 0.0, 0.5)), (1.0, 1.0, 1.0))
    towards = np.array([[1.0, 0.0, 0.0]])
    distances, normals = closest_box_hits([box], np.zeros((1, 3)), towards)
    assert distances == box_distances([box], np.zeros((1, 3)), towards)
    np.testing.assert_allclose(normals, [[-math.cos(0.5), -math.sin(0.5), 0.0]], atol=1e-12)


def test_hits_from_inside_a_box_face_the_ray() -> None:
    distances, normals = closest_box_hits(
        [BOX], np.array([BOX.world_from_box.translation]), np.eye(3)[:1]
    )
    assert distances.tolist() == [0.0]
    assert normals.tolist() == [[-1.0, 0.0, 0.0]]


RED, BLUE = Material((1.0, 0.0, 0.0)), Material((0.0, 0.0, 1.0), unlit=True)
CUBE = primitives.box(Box((0.2, 0.2, 0.2)))
MESH = build_object_mesh([(CUBE, RED), (CUBE.translate((1.0, 0.0, 0.0)), BLUE)])


def test_mesh_keeps_each_patch_its_material() -> None:
    assert len(MESH) == 24
    assert MESH.albedo[0].tolist() == [1.0, 0.0, 0.0]
    assert MESH.albedo[-1].tolist() == [0.0, 0.0, 1.0]
    assert MESH.unlit.tolist() == [False] * 12 + [True] * 12


def test_bounding_sphere_contains_every_corner_and_touches_one() -> None:
    distance = np.linalg.norm(MESH.corners - MESH.centre, axis=-1)
    assert distance.max() == MESH.radius_m
    assert MESH.centre == pytest.approx((0.5, 0.0, 0.0))


def test_world_facets_are_rotated_with_the_object() -> None:
    body = DynamicObject(MESH, Pose.from_rpy((5.0, 0.0, 0.0), (0.0, 0.0, 0.5 * math.pi)))
    ahead = np.flatnonzero(MESH.normals[:, 0] > 0.9)
    np.testing.assert_allclose(world_facets(body).normals[ahead], [[0.0, 1.0, 0.0]] * 4, atol=1e-15)
    assert body.centre == pytest.approx((5.0, 0.5, 0.0))


def test_mesh_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        MESH.corners[0] = 0.0


def test_object_with_a_texture_is_rejected() -> None:
    with pytest.raises(AssertionError, match="no textures"):
        build_object_mesh([(CUBE, Material((1.0, 1.0, 1.0), Path("a.png")))])


@pytest.mark.parametrize(
    ("point", "enclosed"),
    [
        ((5.0, 0.5, 0.0), True),  # between the cubes: in the box around both
        ((5.0, 1.09, 0.0), True),
        ((5.09, 0.5, -0.09), True),
        ((5.0, 1.11, 0.0), False),
        ((5.11, 0.5, 0.0), False),  # in the bounding sphere, not in the turned box
        ((5.0, 0.5, 0.11), False),
        ((-5.0, 0.5, 0.0), False),
    ],
)
def test_object_encloses_the_points_of_its_turned_box(
    point: tuple[float, float, float], enclosed: bool
) -> None:
    body = DynamicObject(MESH, Pose.from_rpy((5.0, 0.0, 0.0), (0.0, 0.0, 0.5 * math.pi)))
    assert body.encloses(np.array(point)) is enclosed
