"""Episodes of a robot on a lockstep server, without Gymnasium."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_client.robot_episodes import RobotEpisodes
from catoptra_protocol.errors import CatoptraError
from helpers.server_process import start_server, write_small_robot


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
