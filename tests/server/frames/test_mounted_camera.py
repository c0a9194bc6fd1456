"""State of a camera on a robot: pose, motion, objects and noise, for frames and tools alike."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.commands import Drive
from catoptra_server.frames.image_port import (
    CameraRobot,
    MountedCamera,
    VisibleObjects,
    mounted_camera_state,
)
from catoptra_server.frames.multi_view import Tile
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import (
    Mount,
    PerspectiveCameraDescription,
    PlanarPose,
)
from catoptra_server.world.obstacle_grid import build_obstacle_grid
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Twist
from helpers.dynamic_objects import place_cube
from helpers.robots import make_p2at, make_walled_world

TILE = Tile(0, 0, 8, 6)
AHEAD = PerspectiveCameraDescription("Ahead", Mount((0.1, 0.0, -0.4)), 12, 10, 1.0, 0.3, 2.0)
EGO_BODY = place_cube(0.0, 0.0, 0.0)


def make_robot() -> Robot:
    description = make_p2at(perspective_cameras=(AHEAD,))
    return Robot(description, PlanarPose(1.0, 2.0, 0.5), name="R", seed=1, time_s=0.0)


def visible_objects(robot: CameraRobot) -> VisibleObjects:
    return VisibleObjects((), EGO_BODY)


def test_state_when_the_robot_is_turned_is_at_the_viewpoint() -> None:
    state = mounted_camera_state(
        Pose.from_rpy((1.0, 2.0, -0.1457), (0.0, 0.0, 0.5)), Pose.from_rpy((0.0, 0.0, -0.4543))
    )
    assert state.world_from_mirror.translation == pytest.approx((1.0, 2.0, -0.6))
    assert state.world_from_mirror.to_rpy() == pytest.approx((0.0, 0.0, 0.5))


def test_twist_when_the_camera_is_off_the_axis_of_a_turn_has_the_lever_s_velocity() -> None:
    turn = Twist((0.2, 0.0, 0.0), (0.0, 0.0, 0.5))
    state = mounted_camera_state(Pose.identity(), Pose.from_rpy((0.4, 0.0, 0.0)), twist=turn)
    # omega x r = (0, 0, 0.5) x (0.4, 0, 0) = (0, 0.2, 0)
    assert state.twist.linear_m_s == pytest.approx((0.2, 0.2, 0.0))
    assert state.twist.angular_rad_s == (0.0, 0.0, 0.5)


def test_view_when_requested_has_the_state_of_camera_and_robot() -> None:
    robot = make_robot()
    robot.drive_wheels(Drive(2.0, 2.0), 0.0)
    scene = build_scene(make_walled_world())
    robot.step(0.02, 0.02, build_obstacle_grid(scene, low_m=0.1, high_m=0.5))
    request = MountedCamera(robot, robot.omni_cameras[0]).request_view(TILE, visible_objects)
    state = request.camera_state
    assert request.camera == robot.omni_cameras[0].camera_spec(TILE)
    expected = robot.world_from_robot @ robot.omni_cameras[0].robot_from_camera({})
    np.testing.assert_array_equal(state.world_from_mirror.translation, expected.translation)
    assert state.noise_seed == robot.noise_seed_for(robot.omni_cameras[0].name)
    assert state.twist.linear_m_s == pytest.approx(robot.twist.linear_m_s)
    assert any(state.twist.linear_m_s)


def test_ego_body_when_the_camera_has_no_mirror_is_left_out() -> None:
    robot = make_robot()
    views = [
        MountedCamera(robot, camera).request_view(TILE, visible_objects)
        for camera in robot.all_cameras
    ]
    is_omni = [isinstance(view.camera, OmniCameraSpec) for view in views]
    assert is_omni == [True, False]
    assert [view.camera_state.ego_body is EGO_BODY for view in views] == is_omni


def test_object_that_encloses_the_viewpoint_is_left_out_but_not_the_ego_body() -> None:
    around, beside = place_cube(1.1, 0.0, -0.6), place_cube(1.3, 0.0, -0.6)
    state = mounted_camera_state(
        Pose.from_rpy((1.0, 0.0, -0.1)),
        Pose.from_rpy((0.0, 0.0, -0.5)),
        objects=(around, beside),
        ego_body=around,
    )
    assert state.objects == (beside,)
    assert state.ego_body is around
