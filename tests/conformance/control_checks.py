"""All checks of the control port."""

from __future__ import annotations

import math

from conformance.check import (
    Check,
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_readings import PlanarPose, find_poses, wrap
from conformance.control_session import spawn_robot
from conformance.control_tour_checks import TOUR_ROWS

_FORWARD_M = 0.2
# Two truncated decimals, and the noise of a sensor at rest.
_MAX_DIFFERENCE_M = 0.1
_MAX_DIFFERENCE_RAD = 0.1


def check_spawn(server: ServerUnderTest) -> None:
    """INIT with a class and a pose, without a name, spawns a robot that reports."""
    with spawn_robot(server):
        pass


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


def _world_pose(poses: dict[str, PlanarPose]) -> PlanarPose:
    """Pose in the world frame, without noise if possible."""
    for type_ in ("groundtruth", "ins"):
        if type_ in poses:
            return poses[type_]
    raise CheckSkipped("neither GroundTruth nor INS reports: no pose in the world frame")


SPAWN_CHECK = check_from_function("spawn", "control", check_spawn, needs_robot=False)
CONTROL_CHECKS: tuple[Check, ...] = (
    SPAWN_CHECK,
    check_from_function("spawn_pose", "control", check_spawn_pose),
    *TOUR_ROWS,
)
