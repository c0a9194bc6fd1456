"""Drives of a robot for the checks of the control port: readings before, between and after.

A drive ends with a command to stand, and the readings of all sensors are compared while the robot
stands: their different times of measurement do not matter.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from conformance.check import CheckFailed
from conformance.control_readings import (
    Cycle,
    DriveBase,
    PlanarMotion,
    PlanarPose,
    find_poses,
    find_ticks,
    read_number,
)
from conformance.control_session import ControlSession, ReceivedLine

FORWARD_FRACTION = 0.8
"""Speed of `drive_forward`, of the maximum."""
STAND = "DRIVE {Left 0} {Right 0}"
# Longest wait for a motion: this many times its duration without slip, and some reports.
_SLOWNESS = 5.0
_REPORTS_S = 1.0
# Two reports of a robot at rest differ by their last decimal, a centimetre in UT2004.
_STANDING_M = 0.015


@dataclass(frozen=True, slots=True)
class Drive:
    """Readings of a drive."""

    before: Cycle
    after: Cycle
    duration_s: float
    """Time in which the robot moved, longer by up to two report intervals; by the clock of the
    server if GroundTruth reports, else by the wall clock.
    """

    def motions(self) -> dict[str, PlanarMotion]:
        """Motion by each sensor that reports poses."""
        start, end = find_poses(self.before), find_poses(self.after)
        return {type_: start[type_].motion_to(end[type_]) for type_ in start if type_ in end}

    def tick_differences(self) -> dict[str, float]:
        """Ticks by each encoder."""
        start, end = find_ticks(self.before), find_ticks(self.after)
        return {name: end[name] - start[name] for name in start if name in end}


def drive_until(
    session: ControlSession,
    command: str,
    is_reached: Callable[[PlanarMotion], bool],
    expected_s: float,
) -> Drive:
    """Drive until the motion by any sensor reaches a goal, or a multiple of the expected time.

    Raises:
        CheckFailed: The robot reports no pose at all.
    """
    before = session.read_next_cycle()
    start = find_poses(before)
    if not start:
        raise CheckFailed("no GroundTruth, INS or Odometry reports: no motion can be observed")
    first = len(session.lines)
    start_s = time.monotonic()

    def has_reached_goal() -> bool:
        return any(is_reached(one) for one in _find_motions(start, session.lines[first:]))

    session.send(command)
    session.read_until(has_reached_goal, _SLOWNESS * expected_s + _REPORTS_S)
    session.send(STAND)
    elapsed_s = time.monotonic() - start_s
    after = session.read_next_cycle()
    moving_s = _find_moving_time(before, session.lines[first:])
    return Drive(before, after, elapsed_s if moving_s is None else moving_s)


def drive_forward(session: ControlSession, base: DriveBase, distance_m: float) -> Drive:
    """Drive straight ahead at FORWARD_FRACTION of the maximum speed."""
    spin = FORWARD_FRACTION * base.max_speed_rad_s
    return drive_until(
        session,
        f"DRIVE {{Left {spin:.4f}}} {{Right {spin:.4f}}}",
        lambda motion: motion.distance_m >= distance_m,
        distance_m / (spin * base.wheel_radius_m),
    )


def drive_turn(
    session: ControlSession, base: DriveBase, right_fraction: float, turn_rad: float
) -> Drive:
    """Drive to the right: the left side at full speed, the right one at a fraction of it."""
    left = base.max_speed_rad_s
    turn_rate = (1.0 - right_fraction) * left * base.wheel_radius_m / base.wheel_separation_m
    return drive_until(
        session,
        f"DRIVE {{Left {left:.4f}}} {{Right {right_fraction * left:.4f}}}",
        lambda motion: abs(motion.yaw_rad) >= turn_rad,
        turn_rad / turn_rate,
    )


def _find_moving_time(before: Cycle, lines: list[ReceivedLine]) -> float | None:
    """Time of the server between the last pose before a drive and the first one after it.

    A busy machine delays commands and reports, but the server's clock and robot alike. None if
    GroundTruth does not report, or without a motion.
    """
    later = [line.message for line in lines if line.sensor_type == "groundtruth"]
    track = [
        (read_number(message, "Time"), find_poses({"groundtruth": [message]})["groundtruth"])
        for message in (*before.get("groundtruth", ()), *later)
    ]
    if not track:
        return None
    start, end = track[0][1], track[-1][1]
    times_at_start = [time_s for time_s, pose in track if _is_same_place(pose, start)]
    times_at_end = [time_s for time_s, pose in track if _is_same_place(pose, end)]
    moving_s = min(times_at_end) - max(times_at_start)
    return moving_s if moving_s > 0.0 else None


def _is_same_place(pose: PlanarPose, other: PlanarPose) -> bool:
    return math.hypot(pose.x_m - other.x_m, pose.y_m - other.y_m) <= _STANDING_M


def _find_motions(start: dict[str, PlanarPose], lines: list[ReceivedLine]) -> list[PlanarMotion]:
    """Motion by the newest pose of each sensor."""
    newest: Cycle = {
        line.sensor_type: [line.message] for line in lines if line.sensor_type in start
    }
    return [start[type_].motion_to(pose) for type_, pose in find_poses(newest).items()]


def describe(motions: dict[str, PlanarMotion]) -> str:
    """Motions for a reason."""
    return ", ".join(
        f"{type_} x {one.x_m:.3f} m, y {one.y_m:.3f} m, yaw {math.degrees(one.yaw_rad):.0f} deg"
        for type_, one in motions.items()
    )
