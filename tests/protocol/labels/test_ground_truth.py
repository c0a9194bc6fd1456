"""Boxes of labelled objects."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.labels.channels import LabelledObject
from catoptra_protocol.optics.transforms import Pose


def test_corners_of_a_turned_box() -> None:
    pose = Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, 0.5 * math.pi))
    box = LabelledObject(1, "crate", "crate", 1, pose, np.array([0.5, 0.25, 0.125]))
    corners = box.corners()
    # Row 1 is positive along the box's x axis alone, which points along the world's y.
    np.testing.assert_allclose(corners[1], (1.25, 2.5, 2.875), atol=1e-12)
    np.testing.assert_allclose(corners.mean(axis=0), (1.0, 2.0, 3.0), atol=1e-12)
