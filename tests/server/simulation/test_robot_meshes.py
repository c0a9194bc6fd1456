"""Meshes of robots: one a class, at the pose of each robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects.effect import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.spawning import RobotMeshes, build_ego_mesh
from helpers.robots import make_p2at


def robot(x_m: float) -> Robot:
    place = PlanarPose(x_m, 0.5, 1.0)
    return Robot(make_p2at(), place, name=f"R{x_m}", seed=0, time_s=0.0)


def test_dynamic_objects_have_the_poses_of_the_robots():
    robots = [robot(0.0), robot(2.0)]
    bodies = RobotMeshes([make_p2at()]).dynamic_objects(robots)
    for body, standing in zip(bodies, robots, strict=True):
        np.testing.assert_array_equal(
            body.world_from_object.translation, standing.world_from_robot.translation
        )


def test_robots_of_a_class_share_one_mesh_for_ever():
    appearance = RobotMeshes([make_p2at()])
    first, second = appearance.dynamic_objects([robot(0.0), robot(1.0)])
    (later,) = appearance.dynamic_objects([robot(3.0)])
    assert first.mesh is second.mesh is later.mesh


@pytest.mark.parametrize("mode", list(EffectMode))
def test_ego_body_when_configured_has_one_mesh_a_class(mode: EffectMode) -> None:
    omni = make_p2at().omni_camera
    assert omni is not None
    effect_settings = EffectSettings((EffectSetting(SelfView(), mode),))
    description = make_p2at(omni_cameras=(replace(omni, effects=effect_settings),))
    appearance = RobotMeshes([description])
    carrier = Robot(description, PlanarPose(1, 2, 3), name="R", seed=0, time_s=0.0)
    first, second = appearance.ego_body(carrier), appearance.ego_body(carrier)
    assert first is not None
    assert second is not None
    assert first.mesh is second.mesh
    assert len(first.mesh) < len(appearance.dynamic_objects([carrier])[0].mesh)


def test_ego_body_when_not_configured_is_not_built() -> None:
    omni = make_p2at().omni_camera
    assert omni is not None
    other = replace(omni, effects=EffectSettings((EffectSetting(Vignetting(), EffectMode.AUTO),)))
    for description in (make_p2at(), make_p2at(omni_cameras=(other,)), make_p2at(omni_cameras=())):
        assert build_ego_mesh(description) is None
    assert RobotMeshes([make_p2at()]).ego_body(robot(0.0)) is None
