"""Checks of range sensors: number of ranges, unit, order, and their change with the motion."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.usarsim.grammar import Message
from conformance.check import CheckFailed, CheckSkipped, ServerUnderTest, check_from_function
from conformance.control_drive import describe, drive_forward, drive_turn
from conformance.control_readings import (
    Cycle,
    Floats,
    Scan,
    find_scan,
    find_sonar_ranges,
    read_drive_base,
    read_number,
)
from conformance.control_session import ControlSession, spawn_robot

# Printed angles are truncated to 4 decimals.
_ANGLE_STEP_RAD = 1e-4
# Noise of a range, and of a range that a sonar's cone or MaxRange limits.
_RANGE_NOISE_M = 0.1
_FORWARD_M = 0.3
_PIVOT_RAD = 0.5
# Of the shift, for slip and the scanner's place off the axis; the opposite sense differs by 2.
_SHIFT_TOLERANCE = 0.5
# A shift is wrong if it fits this much better than each one that agrees with the turn.
_MIN_CONTRAST = 1.5
# Beams on either side of straight ahead.
_FRONT_RAD = 0.05


def check_scan_geometry(server: ServerUnderTest) -> None:
    """A scan has FOV / Resolution + 1 ranges, all within MaxRange metres, as CONF states."""
    with spawn_robot(server) as session:
        scan = find_scan(session.read_next_cycle())
        conf = _query_one(session, "RangeScanner", scan.name)
    # The interval of the true quotient, of two numbers that are truncated.
    fewest = scan.fov_rad / (scan.resolution_rad + _ANGLE_STEP_RAD) + 1.0
    most = (scan.fov_rad + _ANGLE_STEP_RAD) / scan.resolution_rad + 1.0
    if not fewest <= len(scan.ranges_m) <= most:
        raise CheckFailed(
            f"a field of view of {scan.fov_rad} rad by steps of {scan.resolution_rad} rad, both "
            f"ends included: expected {math.ceil(fewest)} to {math.floor(most)} ranges, observed "
            f"{len(scan.ranges_m)}"
        )
    _require_range_limits(conf, scan.ranges_m)
    for name, value in (("Fov", scan.fov_rad), ("Resolution", scan.resolution_rad)):
        if abs(read_number(conf, name) - value) > 2.0 * _ANGLE_STEP_RAD:
            raise CheckFailed(f"{conf}: the scan states {value} rad for {name}")


def check_sonar_ranges(server: ServerUnderTest) -> None:
    """Ranges of sonars lie within MaxRange metres, as CONF states."""
    with spawn_robot(server) as session:
        ranges = find_sonar_ranges(session.read_next_cycle())
        if not ranges:
            raise CheckSkipped("no sonar reports")
        for name, range_m in ranges.items():
            _require_range_limits(_query_one(session, "Sonar", name), np.array([range_m]))


def check_scan_distance(server: ServerUnderTest) -> None:
    """Ahead of a robot that drives forward, ranges shrink by the distance driven."""
    with spawn_robot(server) as session:
        base = read_drive_base(session)
        max_m = read_number(_query_scanner(session), "MaxRange")
        drive = drive_forward(session, base, _FORWARD_M)
    before_m, after_m = _front_ranges(drive.before), _front_ranges(drive.after)
    has_echo = (before_m < 0.98 * max_m) & (after_m < 0.98 * max_m)
    if not has_echo.any():
        raise CheckSkipped("nothing ahead within the range of the scanner")
    change_m = float(np.median((before_m - after_m)[has_echo]))
    distance_m = float(np.median([motion.distance_m for motion in drive.motions().values()]))
    if abs(change_m - distance_m) > 0.3 * distance_m + _RANGE_NOISE_M:
        raise CheckFailed(
            f"drove {distance_m:.3f} m towards an obstacle: the ranges ahead must shrink as much, "
            f"they changed from {np.median(before_m):.3f} to {np.median(after_m):.3f}"
        )


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


def _front_ranges(cycle: Cycle) -> Floats:
    scan = find_scan(cycle)
    middle = len(scan.ranges_m) // 2
    width = max(1, round(_FRONT_RAD / scan.resolution_rad))
    return scan.ranges_m[middle - width : middle + width + 1]


def _require_range_limits(conf: Message, ranges_m: Floats) -> None:
    """Fail where ranges are outside the limits of a sensor's CONF."""
    max_m = read_number(conf, "MaxRange")
    if ranges_m.size == 0 or ranges_m.min() < 0.0 or ranges_m.max() > max_m + _RANGE_NOISE_M:
        raise CheckFailed(
            f"{conf}: expected ranges from 0 to {max_m:g} m, observed "
            f"{ranges_m.min(initial=math.inf):g} to {ranges_m.max(initial=-math.inf):g}"
        )


def _query_one(session: ControlSession, type_: str, name: str) -> Message:
    """CONF of one sensor."""
    for reply in session.query(f"GETCONF {{Type {type_}}} {{Name {name}}}"):
        if reply.word == "CONF" and reply.get("MaxRange") is not None:
            return reply
    raise CheckFailed(f"GETCONF {{Type {type_}}} {{Name {name}}}: no CONF with a MaxRange")


def _query_scanner(session: ControlSession) -> Message:
    return _query_one(session, "RangeScanner", find_scan(session.read_next_cycle()).name)


RANGE_CHECKS = (
    check_from_function("scan_geometry", "control", check_scan_geometry),
    check_from_function("scan_distance", "control", check_scan_distance),
    check_from_function("scan_turn", "control", check_scan_turn),
    check_from_function("sonar_ranges", "control", check_sonar_ranges),
)
