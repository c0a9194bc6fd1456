"""A check of a turn on the stream: poses and pictures agree."""

from __future__ import annotations

import math

from catoptra_client.frame import Frame
from conformance.check import (
    CheckFailed,
    ServerUnderTest,
    check_from_function,
)
from conformance.control_readings import PlanarPose, wrap
from conformance.image_panorama import Panorama, choose_turn, panorama_from_picture, require_turn
from conformance.stream_session import camera_of, planar_pose, pose_of, spawn_on_stream


def check_turn(server: ServerUnderTest) -> None:
    """When the robot turns right, the poses turn with it, and its picture moves left as far."""
    with spawn_on_stream(server) as robot:
        before, start = robot.get_frame(), robot.planar_pose_in_state()
        goal_rad = choose_turn(camera_of(before))
        standing_s = robot.turn_right(goal_rad)
        after, end = robot.get_frame_after(standing_s), robot.planar_pose_in_state()
    poses = planar_pose(pose_of(before)), planar_pose(pose_of(after))
    turns = {"frames": _yaw_difference(*poses), "the state": _yaw_difference(start, end)}
    for name, turn_rad in turns.items():
        if turn_rad < 0.5 * goal_rad:
            raise CheckFailed(
                "the left side forward, the right one backward: by world_from_robot of "
                f"{name} the robot turned by {math.degrees(turn_rad):.1f} deg to the right, "
                f"expected at least {math.degrees(goal_rad):.0f} deg"
            )
    require_turn(_panorama(before), _panorama(after), turns["the state"], "by the state")


def _panorama(frame: Frame) -> Panorama:
    rotation = None if frame.robot_from_mirror is None else frame.robot_from_mirror.rotation
    return panorama_from_picture(frame.rgb, camera_of(frame), rotation)


def _yaw_difference(start: PlanarPose, end: PlanarPose) -> float:
    return wrap(end.yaw_rad - start.yaw_rad)


MOTION_CHECKS = (check_from_function("stream_turn", "stream", check_turn),)
