from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.distances import image_rings
from catoptra_server.effects.bounds.scene_summarizer import DynamicObjectBounds
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.world_description import Twist
from helpers.dynamic_objects import ROBOT_MESH, TWO_ROBOTS, build_cube_mesh
from helpers.worlds import CAMERA_STATE, make_omni_camera

RING = image_rings(make_omni_camera())
LEVEL = int(np.searchsorted(RING.edges_rad, 0.5 * np.pi)) - 1
HERE = np.zeros(3)


def around(*objects: DynamicObject) -> tuple[np.ndarray, np.ndarray]:
    found = DynamicObjectBounds().bound(objects, HERE, np.eye(3), RING)
    return found.min_distances_m, found.max_object_rates_rad_s


def test_cube_ahead_is_as_far_as_its_face() -> None:
    nearest, passing = around(DynamicObject(build_cube_mesh(0.4), Pose.from_rpy((1.2, 0.0, 0.0))))
    assert nearest[LEVEL] == pytest.approx(1.0, rel=1e-3)
    assert np.isinf(nearest[0])
    assert not passing.any()


def test_crossing_object_passes_at_speed_over_distance() -> None:
    moving = DynamicObject(
        build_cube_mesh(0.4), Pose.from_rpy((1.2, 0.0, 0.0)), Twist((0.0, 0.5, 0.0))
    )
    _, passing = around(moving)
    assert passing[LEVEL] == pytest.approx(0.5, rel=1e-3)
    assert passing[0] == 0.0


def test_turning_object_passes_with_its_farthest_corner() -> None:
    turning = DynamicObject(
        build_cube_mesh(0.4), Pose.from_rpy((1.2, 0.0, 0.0)), Twist((0.0,) * 3, (0.0, 0.0, 2.0))
    )
    _, passing = around(turning)
    assert 2.0 * 0.2 * np.sqrt(2.0) < passing[LEVEL] < 2.0 * 0.2 * np.sqrt(3.0) * 1.001


def test_no_corner_of_a_robot_is_nearer_than_its_ring_bound() -> None:
    viewpoint = CAMERA_STATE.world_from_mirror.translation
    found = DynamicObjectBounds().bound(TWO_ROBOTS, viewpoint, np.eye(3), RING)
    for body in TWO_ROBOTS:
        points = (
            body.world_from_object.transform_points(ROBOT_MESH.corners.reshape(-1, 3)) - viewpoint
        )
        theta = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
        ring = np.searchsorted(RING.edges_rad[1:], theta)
        bounds = np.append(found.min_distances_m, 0.0)
        assert (np.linalg.norm(points, axis=-1) >= bounds[ring]).all()
