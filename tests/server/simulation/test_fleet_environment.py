"""Environments: the other robots as boxes, and their names."""

from __future__ import annotations

import numpy as np

from catoptra_server.simulation.cameras import FleetEnvironment
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors.sensor import EmptyScene
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import make_p2at, make_walled_world

WORLD = make_walled_world()
SCENE = build_scene(WORLD)


def make_robots(*names: str) -> list[Robot]:
    """Robots two metres apart along x."""
    return [
        Robot(make_p2at(), PlanarPose(2.0 * i, 0.0, 0.0), name=name, seed=1, time_s=0.0)
        for i, name in enumerate(names)
    ]


def make_environment(robots: list[Robot]) -> FleetEnvironment:
    index = CollisionIndex(SCENE, [make_p2at()])
    return FleetEnvironment(robots, WORLD, SCENE, EmptyScene(), index)


def test_robot_when_it_senses_meets_the_others_and_not_itself() -> None:
    robots = make_robots("A", "B", "C")
    boxes = make_environment(robots).sense(robots[1]).robot_boxes
    assert [float(box.world_from_box.translation[0]) for box in boxes] == [0.0, 4.0]


def test_robot_when_removed_is_not_sensed_any_more() -> None:
    robots = make_robots("A", "B")
    environment = make_environment(robots)
    assert len(environment.sense(robots[0]).robot_boxes) == 1
    robots.pop()
    assert environment.sense(robots[0]).robot_boxes == ()


def test_robot_when_in_view_of_another_has_its_name() -> None:
    robots = make_robots("A", "B")
    things = make_environment(robots).name_things(robots[0])
    distance_m, name = things.find_first(np.array([0.0, 0.0, -0.1]), np.array([1.0, 0.0, 0.0]))
    assert name == "B"
    assert 1.0 < distance_m < 2.0
