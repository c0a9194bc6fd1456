"""Checks of commands by the motion that follows: INIT, DRIVE with Normalized, standing, SET."""

from __future__ import annotations

import math

from conformance.check import (
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_drive import describe, drive_forward, drive_until
from conformance.control_motion_checks import SPEED_RANGE
from conformance.control_readings import PlanarPose, find_poses, read_drive_base, wrap
from conformance.control_session import spawn_robot

_FORWARD_M = 0.2
# Two truncated decimals, and the noise of a sensor at rest.
_MAX_DIFFERENCE_M = 0.1
_MAX_DIFFERENCE_RAD = 0.1
_NORMALIZED_M = 0.12
# Over the speed of the wheels; a robot that ignores Normalized is five times as fast.
_MAX_SPEED_RATIO = 1.7


@retry_once
def check_spawn_pose(server: ServerUnderTest) -> None:
    """Location and Rotation of INIT are the pose that GroundTruth (or INS) reports, in radians."""
    yaw_rad = 1.0
    with spawn_robot(server) as session:
        start = _world_pose(find_poses(session.read_next_cycle()))
    # Another place than the spawn pose, and as free as the checks of motion need it.
    x_m = start.x_m + _FORWARD_M * math.cos(start.yaw_rad)
    y_m = start.y_m + _FORWARD_M * math.sin(start.yaw_rad)
    init = f"{{Location {x_m:.3f},{y_m:.3f},0}} {{Rotation 0,0,{yaw_rad}}}"
    with spawn_robot(server, init) as session:
        pose = _world_pose(find_poses(session.read_next_cycle()))
    if (
        abs(wrap(pose.yaw_rad - yaw_rad)) > _MAX_DIFFERENCE_RAD
        or math.hypot(pose.x_m - x_m, pose.y_m - y_m) > _MAX_DIFFERENCE_M
    ):
        raise CheckFailed(
            f"INIT {init}: the robot stands at {pose.x_m:g},{pose.y_m:g} with a yaw of "
            f"{pose.yaw_rad:g} rad"
        )


@retry_once
def check_normalized(server: ServerUnderTest) -> None:
    """With Normalized, Left and Right are percent of MaxSpeed."""
    percent = 20.0
    with spawn_robot(server) as session:
        base = read_drive_base(session)
        speed = 0.01 * percent * base.max_speed_rad_s * base.wheel_radius_m
        drive = drive_until(
            session,
            f"DRIVE {{Left {percent}}} {{Right {percent}}} {{Normalized true}}",
            lambda motion: motion.distance_m >= _NORMALIZED_M,
            _NORMALIZED_M / speed,
        )
    distance_m = max(motion.distance_m for motion in drive.motions().values())
    slow, _ = SPEED_RANGE
    if not slow * speed <= distance_m / drive.duration_s <= _MAX_SPEED_RATIO * speed:
        raise CheckFailed(
            f"{percent:g} % of MaxSpeed are {speed:.3f} m/s; the robot drove {distance_m:.3f} m in "
            f"{drive.duration_s:.2f} s"
        )


@retry_once
def check_stop(server: ServerUnderTest) -> None:
    """A robot stands after DRIVE with 0 for both sides, by every sensor."""
    with spawn_robot(server) as session:
        stopped = drive_forward(session, read_drive_base(session), _FORWARD_M).after
        later = find_poses(session.read_next_cycle())
    poses = find_poses(stopped)
    motions = {type_: poses[type_].motion_to(later[type_]) for type_ in poses if type_ in later}
    # Two cycles apart: a robot that still drives has moved by a tenth of a metre or two.
    if any(motion.distance_m > 0.25 * _FORWARD_M for motion in motions.values()):
        raise CheckFailed(f"both sides 0: the robot still moves, observed {describe(motions)}")


def _world_pose(poses: dict[str, PlanarPose]) -> PlanarPose:
    """Pose in the world frame, without noise if possible."""
    for type_ in ("groundtruth", "ins"):
        if type_ in poses:
            return poses[type_]
    raise CheckSkipped("neither GroundTruth nor INS reports: no pose in the world frame")


COMMAND_CHECKS = (
    check_from_function("drive_normalized", "control", check_normalized),
    check_from_function("drive_stop", "control", check_stop),
    check_from_function("spawn_pose", "control", check_spawn_pose),
)
