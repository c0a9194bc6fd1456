"""Arrays of a frame and readings: shapes, units, the first of several sensors, and copies."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.frame import Frame
from catoptra_client.robot_episodes import find_planar_pose, observe
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_protocol.usarsim.readings import OdometryReading, RangeScanReading


def make_frame(pose: Pose | None = None) -> Frame:
    rgb = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    rgb.setflags(write=False)
    return Frame(rgb, 1, 0.0, ImageType.RAW, world_from_robot=pose)


def test_observation_without_sensors_is_a_writable_copy_of_the_image() -> None:
    frame = make_frame()
    observation = observe(frame, [])
    assert set(observation) == {"image"}
    observation["image"][0, 0, 0] = 99
    assert frame.rgb[0, 0, 0] == 0


def test_observation_of_several_sensors_has_the_first_of_each_kind() -> None:
    reports = [
        RangeScanReading(0.0, "Front", 0.1, 0.2, (1.0, 2.0, 3.0)),
        OdometryReading("Wheels", 1.0, -2.0, 0.5),
        RangeScanReading(0.0, "Rear", 0.1, 0.2, (4.0, 5.0, 6.0)),
        OdometryReading("Tracks", 9.0, 9.0, 0.9),
    ]
    observation = observe(make_frame(), reports)
    assert observation["scan"].tolist() == [1.0, 2.0, 3.0]
    assert observation["odometry"].tolist() == [1.0, -2.0, 0.5]
    assert observation["scan"].dtype == observation["odometry"].dtype == np.float32


@pytest.mark.parametrize("yaw_rad", [3.1416, -3.1416, 6.2832, math.pi, -math.pi])
def test_yaw_when_printed_as_more_than_pi_is_within_pi_again(yaw_rad: float) -> None:
    (*_, yaw) = observe(make_frame(), [OdometryReading("O", 0.0, 0.0, yaw_rad)])["odometry"]
    assert abs(yaw) <= np.float32(math.pi)
    assert math.cos(yaw) == pytest.approx(math.cos(yaw_rad), abs=1e-6)


def test_planar_pose_is_that_of_the_exposure() -> None:
    frame = make_frame(Pose.from_rpy((1.0, 2.0, -0.2), (0.0, 0.0, 0.7)))
    assert find_planar_pose(frame) == pytest.approx([1.0, 2.0, 0.7])


def test_planar_pose_when_the_frame_has_none_is_an_error() -> None:
    with pytest.raises(DomainError, match="only the stream"):
        find_planar_pose(make_frame())
