"""Perspective cameras: zoom, replies, and the pose on a pan-tilt head."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.robot_description import (
    STANDARD_PACKAGES,
    Mount,
    PerspectiveCameraDescription,
)
from catoptra_server.simulation.sensors.perspective_camera import PerspectiveCameraSensor
from helpers.robots import make_p2at

MOUNT = Mount((0.082, 0.0002, 0.0613), (0.0, 0.0, 0.0), "CameraTilt")
DESCRIPTION = PerspectiveCameraDescription("Camera", MOUNT, 320, 240, 1.3963, 0.3491, 2.0944)


def make_camera() -> PerspectiveCameraSensor:
    return PerspectiveCameraSensor(
        DESCRIPTION, make_p2at(mission_packages=(STANDARD_PACKAGES["camerapantilt"],))
    )


@pytest.mark.parametrize(
    ("requested_rad", "expected_rad"),
    [(0.7853, 0.7853), (0.0, 1.3963), (9.0, 2.0944), (0.01, 0.3491)],
)
def test_zoom_when_requested_stays_within_the_limits(
    requested_rad: float, expected_rad: float
) -> None:
    sensor = make_camera()
    assert sensor.zoom(requested_rad) == expected_rad == sensor.fov_rad


def test_replies_are_in_degrees_and_of_the_mount() -> None:
    conf = line_from_report(make_camera().configuration()).decode()
    assert conf.startswith("CONF {Type Camera} {Name Camera} {CameraDefFov 80.00")
    assert make_camera().geometry().mount == "CameraTilt"


def test_pose_at_rest_is_upright_above_the_head() -> None:
    pose = make_camera().robot_from_camera({})
    np.testing.assert_allclose(pose.rotation, np.eye(3), atol=1e-12)
    expected = (0.1239 + 0.082, 0.0002, -0.2036 - 0.0599 + 0.0613)
    np.testing.assert_allclose(pose.translation, expected, atol=1e-12)


def test_view_when_panned_and_tilted_turns_left_and_up() -> None:
    forward = make_camera().robot_from_camera({"camerapan": math.pi / 2}).rotation[:, 0]
    np.testing.assert_allclose(forward, (0.0, -1.0, 0.0), atol=1e-12)
    forward = make_camera().robot_from_camera({"cameratilt": math.pi / 2}).rotation[:, 0]
    np.testing.assert_allclose(forward, (0.0, 0.0, -1.0), atol=1e-12)
