"""What robots look like: one mesh a class, at the pose of each robot."""

from __future__ import annotations

import numpy as np

from catoptra_server.robot.pose import PlanarPose
from catoptra_server.simulation.appearance import Appearance
from catoptra_server.simulation.spawned_robot import SpawnedRobot
from helpers.robots import p2at


def robot(x_m: float) -> SpawnedRobot:
    place = PlanarPose(x_m, 0.5, 1.0)
    return SpawnedRobot(p2at(), place, name=f"R{x_m}", seed=0, time_s=0.0)


def test_bodies_stand_where_their_robots_do():
    robots = [robot(0.0), robot(2.0)]
    bodies = Appearance([p2at()]).bodies(robots)
    for body, standing in zip(bodies, robots, strict=True):
        np.testing.assert_array_equal(
            body.world_from_body.translation, standing.world_from_robot.translation
        )


def test_robots_of_a_class_share_one_mesh_for_ever():
    appearance = Appearance([p2at()])
    first, second = appearance.bodies([robot(0.0), robot(1.0)])
    (later,) = appearance.bodies([robot(3.0)])
    assert first.mesh is second.mesh is later.mesh
