"""Episodes of a robot, and what it observes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.frame import Frame
from catoptra_client.robot_episodes import RobotEpisodes, describe_pose, observe
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_protocol.usarsim.readings import OdometryReading, RangeScanReading
from helpers.server_process import start_server, write_small_robot


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


def test_pose_is_that_of_the_exposure() -> None:
    pose = describe_pose(make_frame(Pose.from_rpy((1.0, 2.0, -0.2), (0.1, 0.3, 0.7))))
    assert pose["pose"] == pytest.approx([1.0, 2.0, 0.7])
    assert pose["z_roll_pitch"] == pytest.approx([-0.2, 0.1, 0.3])


def test_pose_when_the_frame_has_none_is_an_error() -> None:
    with pytest.raises(DomainError, match="only the stream"):
        describe_pose(make_frame())


def test_same_generator_gives_the_same_episode(tmp_path: Path) -> None:
    robot = write_small_robot(tmp_path)
    with (
        start_server(tmp_path, "--clock", "lockstep", robot=robot) as server,
        server.connect_stream() as client,
    ):
        episodes = RobotEpisodes(client, robot_class="", camera="", step_s=0.2)
        seen = []
        for _ in range(2):
            first, info = episodes.begin(np.random.default_rng(3), (0.5, 0.2, 0.1))
            transition = episodes.advance(np.array((0.5, 0.4)))
            seen.append((first["image"], transition.next_observation["odometry"]))
            assert info["time_s"] == 0.0
            assert transition.next_info["time_s"] == pytest.approx(0.2)
            np.testing.assert_array_equal(transition.observation["image"], first["image"])
            assert episodes.newest[1]["time_s"] == transition.next_info["time_s"]
        for before, after in zip(*seen, strict=True):
            np.testing.assert_array_equal(before, after)
        with server.connect_stream() as other:
            other.spawn(client.get_status().class_names[0], location_m=(-1.0, 0.0, 0.0))
            with pytest.raises(CatoptraError, match="has other robots"):
                episodes.begin(np.random.default_rng(3), (0.5, 0.2, 0.1))
