from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world import shapes as primitives
from catoptra_server.world.objects import DynamicObject, build_object_mesh, world_facets
from catoptra_server.world.world_description import Box, Material

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
