"""Rays and boxes: from all sides, rotated, from inside, misses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.objects import OrientedBox, box_distances, closest_box_hits

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
