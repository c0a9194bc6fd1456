"""Odometry at the time of an exposure, between two readings of the sensor.

A frame arrives tens of milliseconds after its exposure, on a busy machine a second, and in the
turns of the route 50 ms are 4 degrees.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_client.localization import OdometryPose
from catoptra_protocol.optics.numerics import angle_difference, wrap_angle


@dataclass(frozen=True, slots=True)
class TimedOdometry:
    """One reading."""

    time_s: float
    """Simulation time."""

    pose: OdometryPose


def interpolate_odometry(readings: Sequence[TimedOdometry], time_s: float) -> OdometryPose | None:
    """Odometry at a time, on the straight line between two readings.

    Args:
        readings: Readings, the oldest first.
        time_s: Simulation time; before the oldest reading, that one counts.

    Returns:
        The pose; None after the newest reading.
    """
    index = bisect_left(readings, time_s, key=lambda reading: reading.time_s)
    if index == len(readings):
        return None
    after = readings[index]
    if index == 0:
        return after.pose
    before = readings[index - 1]
    fraction = (time_s - before.time_s) / (after.time_s - before.time_s)
    turn_rad = angle_difference(after.pose.yaw_rad, before.pose.yaw_rad)
    return OdometryPose(
        before.pose.x_m + fraction * (after.pose.x_m - before.pose.x_m),
        before.pose.y_m + fraction * (after.pose.y_m - before.pose.y_m),
        wrap_angle(before.pose.yaw_rad + fraction * turn_rad),
    )
