"""From odometry poses to the filter's control. Odometry poses live in a frame of their own."""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_client.localization.motion_model import Control, chord_over_arc
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import angle_difference


@dataclass(frozen=True, slots=True)
class OdometryPose:
    """What USARSim's odometry sensor reports: x, y from the start pose and yaw.

    Raises DomainError for numbers that are not finite.
    """

    x_m: float
    y_m: float
    yaw_rad: float

    def __post_init__(self) -> None:
        numbers = (self.x_m, self.y_m, self.yaw_rad)
        if not all(map(math.isfinite, numbers)):
            raise DomainError(f"an odometry pose (x, y, yaw) must be finite: {numbers}")


def control_from_odometry(previous: OdometryPose, current: OdometryPose) -> Control:
    """Return the control u = (v, delta phi) that leads from one odometry pose to the next.

    The chord is projected on the middle heading phi + a and divided by S = sin(a) / a: of an arc
    that is its length, negative when driven backwards. A projection has no jump in sign where a
    turn on the spot leaves a millimetre of noise; what slipped sideways is no part of (v, delta
    phi) and is dropped. |a| <= pi / 2, so S >= 2 / pi.
    """
    turn = angle_difference(current.yaw_rad, previous.yaw_rad)
    heading = previous.yaw_rad + 0.5 * turn
    dx, dy = current.x_m - previous.x_m, current.y_m - previous.y_m
    chord = dx * math.cos(heading) + dy * math.sin(heading)
    return Control(chord / chord_over_arc(0.5 * turn), turn)
