"""A frame and the sensor readings of its time as named arrays, for programs that learn."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_client.frame import Frame
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.usarsim.readings import OdometryReading, RangeScanReading
from catoptra_protocol.usarsim.reports import Report

Observation = dict[str, npt.NDArray[Any]]


def observe(frame: Frame, reports: Iterable[Report]) -> Observation:
    """Arrays of what a robot measures, for the caller to keep and to write into.

    Args:
        frame: Frame of the robot's camera.
        reports: Readings of all its sensors.

    Returns:
        `image` (h, w, 3) uint8 RGB; `odometry` (3,) float32, x and y in metres and yaw in radians
        in [-pi, pi] from the pose of spawning; `scan` (n,) float32, ranges in metres from right to
        left. The latter two if the reports have them, and of several sensors the first.
    """
    observation = {"image": frame.rgb.copy()}
    for report in reports:
        if isinstance(report, OdometryReading):
            # Wrapped again: a heading just below pi is printed as more than pi.
            pose = (report.x_m, report.y_m, math.remainder(report.yaw_rad, math.tau))
            observation.setdefault("odometry", np.array(pose, np.float32))
        elif isinstance(report, RangeScanReading):
            observation.setdefault("scan", np.array(report.ranges_m, np.float32))
    return observation


def find_planar_pose(frame: Frame) -> Floats:
    """True pose (3,) of the robot at the exposure: x and y in metres, yaw in radians, in the world.

    Raises:
        DomainError: The frame has no pose, as those of the image port.
    """
    if frame.world_from_robot is None:
        raise DomainError("only the stream sends the robot's pose with a frame")
    x_m, y_m, _ = frame.world_from_robot.translation
    return np.array((x_m, y_m, frame.world_from_robot.to_rpy()[2]))
