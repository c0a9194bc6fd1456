"""Odometry: from two poses to a control, and back through the motion model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.localization import Control, OdometryPose, control_from_odometry
from catoptra_client.localization.motion_model import propagate_pose

START = OdometryPose(0.4, -0.2, 2.5)


def propagate_odometry(control: Control) -> OdometryPose:
    return OdometryPose(
        *propagate_pose(np.array([START.x_m, START.y_m, START.yaw_rad]), control).tolist()
    )


@pytest.mark.parametrize("distance_m", [0.2, -0.2, 0.0, 3.0])
@pytest.mark.parametrize("turn_rad", [0.0, 1e-12, 0.3, -0.8, 2.0, 3.1, -3.1])
def test_control_is_recovered_from_the_poses_it_led_to(distance_m, turn_rad) -> None:
    control = control_from_odometry(START, propagate_odometry(Control(distance_m, turn_rad)))
    assert control.distance_m == pytest.approx(distance_m, abs=1e-14)
    assert control.turn_rad == pytest.approx(turn_rad, abs=1e-14)


def test_turn_across_the_wrap_is_short() -> None:
    control = control_from_odometry(OdometryPose(0, 0, 3.1), OdometryPose(0, 0, -3.1))
    assert control.turn_rad == pytest.approx(2 * math.pi - 6.2)


def test_standing_still_is_no_control() -> None:
    assert control_from_odometry(START, START) == Control(0.0, 0.0)


def test_slip_to_the_side_is_no_driving() -> None:
    control = control_from_odometry(OdometryPose(0, 0, 0), OdometryPose(0.2, 0.05, 0))
    assert control.distance_m == pytest.approx(0.2)
