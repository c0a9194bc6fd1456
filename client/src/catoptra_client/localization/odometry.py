"""Odometry: from two odometry poses, in a frame of their own, to the filter's control."""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_client.localization.motion_model import Control, chord_over_arc
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import angle_difference


@dataclass(frozen=True, slots=True)
class OdometryPose:
    """Pose as USARSim's odometry sensor reports, relative to the start pose.

    Raises:
        DomainError: a number is not finite.
    """

    x_m: float
    """Forward at the start."""
    y_m: float
    """To the right at the start."""
    yaw_rad: float
    """Yaw, positive to the right."""

    def __post_init__(self) -> None:
        numbers = (self.x_m, self.y_m, self.yaw_rad)
        if not all(map(math.isfinite, numbers)):
            raise DomainError(f"an odometry pose (x, y, yaw) must be finite: {numbers}")


def control_from_odometry(previous: OdometryPose, current: OdometryPose) -> Control:
    """Control u = (v, delta phi) that leads from one odometry pose to the next.

    The displacement is projected on the mean heading phi + a and divided by S = sin(a) / a: of an
    arc that is the length, negative when driven backwards. Lateral slip is no part of (v, delta
    phi) and is dropped.
    """
    turn = angle_difference(current.yaw_rad, previous.yaw_rad)
    heading = previous.yaw_rad + 0.5 * turn
    dx, dy = current.x_m - previous.x_m, current.y_m - previous.y_m
    # A projection keeps the sign continuous where a turn on the spot leaves a millimetre of noise;
    # the length of the displacement would not. |a| <= pi / 2, so S >= 2 / pi.
    chord = dx * math.cos(heading) + dy * math.sin(heading)
    return Control(chord / chord_over_arc(0.5 * turn), turn)
