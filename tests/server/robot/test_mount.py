"""Mounts."""

from __future__ import annotations

import math

import numpy as np

from catoptra_server.robot.mount import Mount


def test_mount_when_nothing_is_said_is_the_chassis() -> None:
    assert Mount().parent == "HARD"


def test_transform_when_turned_looks_aside() -> None:
    pose = Mount((0.1, 0.2, 0.3), (0.0, 0.0, math.pi / 2)).parent_from_item()
    np.testing.assert_allclose(pose.transform_points(np.array([1.0, 0.0, 0.0])), (0.1, 1.2, 0.3))
