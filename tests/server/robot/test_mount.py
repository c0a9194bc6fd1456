"""Mounts."""

from __future__ import annotations

import math

import numpy as np

from catoptra_server.simulation.robot_description import Mount


def test_mount_by_default_is_the_chassis() -> None:
    assert Mount().parent == "HARD"


def test_transform_of_a_turned_mount_faces_sideways() -> None:
    pose = Mount((0.1, 0.2, 0.3), (0.0, 0.0, math.pi / 2)).parent_from_item()
    np.testing.assert_allclose(pose.transform_points(np.array([1.0, 0.0, 0.0])), (0.1, 1.2, 0.3))
