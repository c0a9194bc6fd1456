"""Checks of motion: wheels, poses and encoders of one drive against each other.

Tolerances are wide, for slip, noise and the two decimals of UT2004: a wrong sign, axis, unit or
side exceeds each of them, a poor sensor does not.
"""

from __future__ import annotations

import itertools
import math

from conformance.check import (
    CheckFailed,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_drive import (
    FORWARD_FRACTION,
    Drive,
    describe,
    drive_forward,
    drive_turn,
)
from conformance.control_readings import (
    DriveBase,
    PlanarMotion,
    read_drive_base,
    wrap,
)
from conformance.control_session import spawn_robot

_FORWARD_M = 0.2
_TURN_RAD = 0.6
# Of the larger of two motions; odometry of a skid-steered robot on slippery ground is this poor.
_MAX_RELATIVE_DIFFERENCE = 0.4
# Two truncated decimals, and the noise of a few decimetres.
_MAX_DIFFERENCE_M = 0.05
_MAX_DIFFERENCE_RAD = 0.1
# Mean speed over the speed of the wheels: slip and latency below, the time to halt above.
SPEED_RANGE = (0.25, 1.5)


@retry_once
def check_forward(server: ServerUnderTest) -> None:
    """Both sides forward: all sensors see one straight motion, as fast as the wheels roll."""
    with spawn_robot(server) as session:
        base = read_drive_base(session)
        drive = drive_forward(session, base, _FORWARD_M)
    motions = drive.motions()
    for type_, motion in motions.items():
        if motion.x_m < 0.5 * _FORWARD_M or abs(motion.y_m) > 0.5 * motion.x_m:
            raise CheckFailed(
                f"both sides forward: {type_} must move along its heading by about {_FORWARD_M} m "
                f"in {drive.duration_s:.2f} s, observed {describe(motions)}"
            )
    _require_agreement(motions)
    _require_wheel_speed(drive, base)
    ticks = _find_side_ticks(drive)
    if ticks and math.prod(ticks) <= 0:
        raise CheckFailed(f"both sides forward: encoders counted {ticks} (left, right)")


def check_curve(server: ServerUnderTest) -> None:
    """The left side faster: yaw and y grow, by all sensors alike (clockwise, to the right)."""
    with spawn_robot(server) as session:
        base = read_drive_base(session)
        drive = drive_turn(session, base, 0.4, _TURN_RAD)
    motions = drive.motions()
    for type_, motion in motions.items():
        if motion.yaw_rad < 0.25 * _TURN_RAD or motion.y_m < 0.0:
            raise CheckFailed(
                f"the left side faster turns right: yaw and y of {type_} must grow (clockwise "
                f"seen from above, y to the right), observed {describe(motions)}"
            )
    _require_agreement(motions)
    ticks = _find_side_ticks(drive)
    if ticks and abs(ticks[0]) <= abs(ticks[1]):
        raise CheckFailed(f"the left side faster: encoders counted {ticks} (left, right)")


def check_pivot(server: ServerUnderTest) -> None:
    """Sides against each other: the robot turns on its place, the left side forward."""
    with spawn_robot(server) as session:
        drive = drive_turn(session, read_drive_base(session), -1.0, _TURN_RAD)
        motions = drive.motions()
        for type_, motion in motions.items():
            if motion.yaw_rad < 0.25 * _TURN_RAD or motion.distance_m > 0.3:
                raise CheckFailed(
                    f"left forward, right backward turns on the place, clockwise: {type_} "
                    f"disagrees, observed {describe(motions)}"
                )
    ticks = _find_side_ticks(drive)
    if ticks and math.prod(ticks) >= 0:
        raise CheckFailed(f"sides against each other: encoders counted {ticks} (left, right)")


def _require_agreement(motions: dict[str, PlanarMotion]) -> None:
    """Fail where two sensors report different motions."""
    for (type_a, a), (type_b, b) in itertools.combinations(motions.items(), 2):
        distance_m = math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
        turn_rad = abs(wrap(a.yaw_rad - b.yaw_rad))
        larger_m = max(a.distance_m, b.distance_m)
        larger_rad = max(abs(a.yaw_rad), abs(b.yaw_rad))
        if (
            distance_m > _MAX_RELATIVE_DIFFERENCE * larger_m + _MAX_DIFFERENCE_M
            or turn_rad > _MAX_RELATIVE_DIFFERENCE * larger_rad + _MAX_DIFFERENCE_RAD
        ):
            raise CheckFailed(
                f"{type_a} and {type_b} disagree about one drive: observed {describe(motions)}"
            )


def _require_wheel_speed(drive: Drive, base: DriveBase) -> None:
    """Fail where a drive straight ahead is not as long as its wheels rolled."""
    wheel_m = FORWARD_FRACTION * base.max_speed_rad_s * base.wheel_radius_m * drive.duration_s
    distance_m = max(motion.distance_m for motion in drive.motions().values())
    slow, fast = SPEED_RANGE
    if not slow * wheel_m <= distance_m <= fast * wheel_m + _MAX_DIFFERENCE_M:
        raise CheckFailed(
            f"wheels that roll {wheel_m:.3f} m in {drive.duration_s:.2f} s: the robot moved "
            f"{distance_m:.3f} m"
        )


def _find_side_ticks(drive: Drive) -> tuple[float, float] | None:
    """Ticks of the encoders of the left and right side; None if no names say the side."""
    ticks = drive.tick_differences()
    left = [count for name, count in ticks.items() if "left" in name]
    right = [count for name, count in ticks.items() if "right" in name]
    return (left[0], right[0]) if left and right else None


MOTION_CHECKS = (
    check_from_function("drive_forward", "control", check_forward),
    check_from_function("drive_curve", "control", check_curve),
    check_from_function("drive_pivot", "control", check_pivot),
)
