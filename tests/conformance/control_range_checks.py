"""Check of the order of ranges in a scan, by their change in a turn."""

from __future__ import annotations

import math

import numpy as np

from conformance.check import CheckFailed, CheckSkipped, ServerUnderTest, check_from_function
from conformance.control_drive import describe, drive_turn
from conformance.control_readings import (
    Scan,
    find_scan,
    read_drive_base,
)
from conformance.control_session import spawn_robot

_PIVOT_RAD = 0.5
# Of the shift, for slip and the scanner's place off the axis; the opposite sense differs by 2.
_SHIFT_TOLERANCE = 0.5
# A shift is wrong if it fits this much better than each one that agrees with the turn.
_MIN_CONTRAST = 1.5


def check_scan_turn(server: ServerUnderTest) -> None:
    """In a turn to the right the scan shifts to the left, by the angle of the turn."""
    with spawn_robot(server) as session:
        drive = drive_turn(session, read_drive_base(session), -1.0, _PIVOT_RAD)
    before, after = find_scan(drive.before), find_scan(drive.after)
    motions = drive.motions()
    turn_rad = float(np.median([motion.yaw_rad for motion in motions.values()]))
    # Ranges go from right to left: a turn to the right moves obstacles to later indices.
    expected = turn_rad / before.resolution_rad
    costs = {
        shift: cost
        for shift, cost in _shift_costs(before, after).items()
        if abs(shift) <= (1.0 + 2.0 * _SHIFT_TOLERANCE) * abs(expected)
    }
    best = min(costs, key=lambda shift: costs[shift])
    width = _SHIFT_TOLERANCE * abs(expected)
    if abs(best - expected) <= width:
        return
    # Another shift must fit clearly better than all that agree with the turn.
    if _MIN_CONTRAST * costs[best] >= min(
        (cost for shift, cost in costs.items() if abs(shift - expected) <= width), default=math.inf
    ):
        raise CheckSkipped("the surroundings look alike before and after a turn")
    raise CheckFailed(
        f"a turn of {math.degrees(turn_rad):.0f} deg to the right ({describe(motions)}): the "
        f"scan, from right to left, must shift by {expected:.0f} ranges, it shifted by {best}"
    )


def _shift_costs(before: Scan, after: Scan) -> dict[int, float]:
    """Mean difference of the overlap of two scans by shift, up to half a scan."""
    count = min(len(before.ranges_m), len(after.ranges_m))
    a, b = before.ranges_m[:count], after.ranges_m[:count]
    return {
        shift: float(
            np.abs(
                a[max(0, -shift) : count - shift] - b[max(0, shift) :][: count - abs(shift)]
            ).mean()
        )
        # At least half of the scans must overlap.
        for shift in range(-(count // 2), count // 2 + 1)
    }


RANGE_CHECKS = (check_from_function("scan_turn", "control", check_scan_turn),)
