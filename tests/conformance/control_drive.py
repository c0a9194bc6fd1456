"""Drives of a robot until it has moved, for the checks of the control and the image port.

A drive ends with a command to stand, and the readings of all sensors are compared while the robot
stands: their different times of measurement do not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from conformance.check import CheckFailed, CheckSkipped
from conformance.control_readings import (
    Cycle,
    PlanarMotion,
    PlanarPose,
    find_poses,
    read_number,
)
from conformance.control_session import ControlSession, ReceivedLine

STAND = "DRIVE {Left 0} {Right 0}"
# Longest wait for a motion of some decimetres, by a slow robot on a busy machine.
_DRIVE_S = 10.0


def require_sides(session: ControlSession) -> None:
    """Skip robots that do not move, or do not steer by the speeds of their sides."""
    confs = session.query("GETCONF {Type Robot}")
    steering = {one.get("SteeringType") for one in confs} - {None}
    if not steering <= {"SkidSteered", "Differential"}:
        raise CheckSkipped(f"a robot with the steering {', '.join(map(str, steering))}")
    if any(one.get("MaxSpeed") is not None and not read_number(one, "MaxSpeed") for one in confs):
        raise CheckSkipped("a robot that stays where it is: MaxSpeed 0")


def drive_until(
    session: ControlSession,
    left_percent: float,
    right_percent: float,
    is_reached: Callable[[PlanarMotion], bool],
) -> dict[str, PlanarMotion]:
    """Drive until the motion by any sensor reaches a goal; motion by each sensor, once it stands.

    Raises:
        CheckFailed: The robot reports no pose at all.
    """
    start = find_poses(session.read_next_cycle())
    if not start:
        raise CheckFailed("no GroundTruth, INS or Odometry reports: no motion can be observed")
    first = len(session.lines)

    def has_reached_goal() -> bool:
        return any(is_reached(one) for one in _find_motions(start, session.lines[first:]).values())

    session.send(f"DRIVE {{Left {left_percent:g}}} {{Right {right_percent:g}}} {{Normalized true}}")
    session.read_until(has_reached_goal, _DRIVE_S)
    session.send(STAND)
    end = find_poses(session.read_next_cycle())
    return {type_: start[type_].motion_to(end[type_]) for type_ in start if type_ in end}


def describe(motions: dict[str, PlanarMotion]) -> str:
    """Motions for a reason."""
    return ", ".join(
        f"{type_} x {one.x_m:.3f} m, y {one.y_m:.3f} m, yaw {math.degrees(one.yaw_rad):.0f} deg"
        for type_, one in motions.items()
    )


def _find_motions(
    start: dict[str, PlanarPose], lines: list[ReceivedLine]
) -> dict[str, PlanarMotion]:
    """Motion by the newest pose of each sensor."""
    newest: Cycle = {
        line.sensor_type: [line.message] for line in lines if line.sensor_type in start
    }
    return {type_: start[type_].motion_to(pose) for type_, pose in find_poses(newest).items()}
