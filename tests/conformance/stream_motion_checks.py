"""Checks of a turn and of the clock on the stream: pose, readings, landmarks and pictures agree."""

from __future__ import annotations

import math

from catoptra_client.frame import Frame
from conformance.check import (
    CheckFailed,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_readings import PlanarPose, wrap
from conformance.image_panorama import Panorama, choose_turn, panorama_from_picture, require_turn
from conformance.stream_session import StreamRobot, camera_of, planar_pose, pose_of, spawn_on_stream

_TURN_RAD = 0.4
# Two truncated decimals of a reading, and the millimetres of a robot that comes to a halt.
_POSE_TOLERANCE_M, _POSE_TOLERANCE_RAD = 0.03, 0.03
# Of the clock against the wall clock, over this time: a busy machine.
_CLOCK_S = 0.5
_CLOCK_TOLERANCE_S = 0.25
_READING_TIMEOUT_S = 2.0


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


def check_poses(server: ServerUnderTest) -> None:
    """Pose of frames, pose of the state and GroundTruth agree, also after a turn."""
    with spawn_on_stream(server) as robot:
        _require_equal_poses(robot, robot.wait_until_standing())
        _require_equal_poses(robot, robot.turn_right(_TURN_RAD))


@retry_once
def check_clock(server: ServerUnderTest) -> None:
    """time_s of the state advances with the wall clock, time_s + age_s of frames with it."""
    with spawn_on_stream(server) as robot:
        first_s, start_s = robot.read_time_s(), robot.clock()
        _require_present(robot)
        while (elapsed_s := robot.clock() - start_s) < _CLOCK_S:
            time_s = robot.read_time_s()
        _require_present(robot)
    if abs(time_s - first_s - elapsed_s) > _CLOCK_TOLERANCE_S:
        raise CheckFailed(
            f"time_s of the state advanced by {time_s - first_s:.3f} s in {elapsed_s:.3f} s of a "
            "realtime clock"
        )


def _require_present(robot: StreamRobot) -> None:
    """Fail where exposure and age of a frame do not add up to its time of arrival."""
    frame, now_s = robot.get_frame(), robot.read_time_s()
    exposed_s, age_s = frame.time_s or 0.0, frame.age_s or 0.0
    if age_s < 0.0 or abs(exposed_s + age_s - now_s) > _CLOCK_TOLERANCE_S:
        raise CheckFailed(
            f"a frame exposed at {exposed_s:.3f} s and {age_s:.3f} s old arrived at {now_s:.3f} s"
        )


def _require_equal_poses(robot: StreamRobot, standing_s: float) -> None:
    """Fail where a standing robot has different poses; a reading may come a report later."""
    in_frame = planar_pose(pose_of(robot.get_frame_after(standing_s)))
    _require_equal(in_frame, robot.planar_pose_in_state(), "state")
    deadline_s = robot.clock() + _READING_TIMEOUT_S
    while (in_reading := robot.planar_pose_in_readings()) is not None:
        if _are_equal(in_frame, in_reading) or robot.clock() > deadline_s:
            _require_equal(in_frame, in_reading, "GroundTruth")
            return


def _require_equal(in_frame: PlanarPose, other: PlanarPose, name: str) -> None:
    if not _are_equal(in_frame, other):
        raise CheckFailed(f"world_from_robot of a frame is {in_frame}, by the {name} {other}")


def _are_equal(one: PlanarPose, other: PlanarPose) -> bool:
    motion = one.motion_to(other)
    return motion.distance_m < _POSE_TOLERANCE_M and abs(motion.yaw_rad) < _POSE_TOLERANCE_RAD


def _panorama(frame: Frame) -> Panorama:
    rotation = None if frame.robot_from_mirror is None else frame.robot_from_mirror.rotation
    return panorama_from_picture(frame.rgb, camera_of(frame), rotation)


def _yaw_difference(start: PlanarPose, end: PlanarPose) -> float:
    return wrap(end.yaw_rad - start.yaw_rad)


MOTION_CHECKS = (
    check_from_function("stream_turn", "stream", check_turn),
    check_from_function("stream_poses", "stream", check_poses),
    check_from_function("stream_clock", "stream", check_clock),
)
