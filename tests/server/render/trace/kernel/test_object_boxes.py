"""Boxes around the parts of a dynamic object."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.kernel.exposure_arrays import enclose_parts
from catoptra_server.world.objects import ObjectMesh, build_object_mesh
from catoptra_server.world.shapes import Patch
from catoptra_server.world.world_description import Material
from measurements.scenes import ROBOT


def make_mesh(corners: Floats) -> ObjectMesh:
    """Mesh of (n, 3, 3) corners."""
    return build_object_mesh(
        [(Patch(corners, np.zeros((len(corners), 3, 2))), Material((1.0, 1.0, 1.0)))]
    )


def surface(boxes: Floats) -> float:
    """Surface of all boxes together."""
    x, y, z = 2.0 * boxes[:, 3:].T
    return float((2.0 * (x * y + y * z + z * x)).sum())


def holds(boxes: Floats, mesh: ObjectMesh) -> bool:
    """Whether each triangle lies in one of the boxes."""
    offsets = np.abs(mesh.corners[:, :, None] - boxes[:, :3])
    return bool((offsets <= boxes[:, 3:] + 1e-12).all(axis=(1, 3)).any(axis=1).all())


def test_robot_with_a_tower_has_boxes_with_much_less_surface_than_one() -> None:
    boxes = enclose_parts(ROBOT)
    assert holds(boxes, ROBOT)
    one = np.concatenate([ROBOT.centre, ROBOT.half_size_m])[None]
    assert 1 < len(boxes) <= 8
    assert surface(boxes) < 0.75 * surface(one)


@pytest.mark.parametrize("seed", range(5))
def test_boxes_of_random_triangles_hold_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = rng.choice(rng.uniform(-1.0, 1.0, (4, 3)), 60)
    mesh = make_mesh(centres[:, None] + rng.uniform(-0.1, 0.1, (60, 3, 3)))
    boxes = enclose_parts(mesh)
    assert holds(boxes, mesh)
    assert 2 <= len(boxes) <= 8


def test_box_of_one_triangle_is_its_own() -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 4.0, 0.0]]])
    np.testing.assert_allclose(enclose_parts(make_mesh(corners)), [[1.0, 2.0, 0.0, 1.0, 2.0, 0.0]])


def test_triangles_that_all_overlap_have_one_box() -> None:
    rng = np.random.default_rng(1)
    corners = rng.uniform(-1.0, 1.0, (1, 3, 3)) + 1e-3 * rng.uniform(-1.0, 1.0, (20, 1, 1))
    assert len(enclose_parts(make_mesh(corners))) == 1
