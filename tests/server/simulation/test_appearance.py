"""What robots look like: one mesh a class, at the pose of each robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects.effect import EffectWishes, Mode, Wish
from catoptra_server.effects.own_body import OwnBody
from catoptra_server.effects.vignetting import Vignetting
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.simulation.appearance import Appearance, own_mesh
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


@pytest.mark.parametrize("mode", list(Mode))
def test_own_body_when_the_camera_names_it_is_made_once_a_class(mode: Mode) -> None:
    omni = p2at().omni_camera
    assert omni is not None
    wishes = EffectWishes((Wish(OwnBody(), mode),))
    description = p2at(omni_camera=replace(omni, effects=wishes))
    appearance = Appearance([description])
    carrier = SpawnedRobot(description, PlanarPose(1, 2, 3), name="R", seed=0, time_s=0.0)
    first, second = appearance.own_body(carrier), appearance.own_body(carrier)
    assert first is not None
    assert second is not None
    assert first.mesh is second.mesh
    assert len(first.mesh) < len(appearance.bodies([carrier])[0].mesh)


def test_own_body_when_nobody_names_it_is_not_made() -> None:
    omni = p2at().omni_camera
    assert omni is not None
    other = replace(omni, effects=EffectWishes((Wish(Vignetting(), Mode.AUTO),)))
    for description in (p2at(), p2at(omni_camera=other), p2at(omni_camera=None)):
        assert own_mesh(description) is None
    assert Appearance([p2at()]).own_body(robot(0.0)) is None
