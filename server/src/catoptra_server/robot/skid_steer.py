"""Kinematics of a skid-steered base: wheel spin to wheel travel, wheel travel to a new pose.

Both wheels of a side spin alike. Yaw grows clockwise (SAE), hence with the travel of the left side:
turn = (left - right) / track, as USARSim's odometry integrates wheel rotations.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import DriveBase


@dataclass(frozen=True, slots=True)
class WheelSpin:
    """Commanded spin of the wheels of each side."""

    left_rad_s: float = 0.0
    right_rad_s: float = 0.0

    def clamp(self, max_rad_s: float) -> WheelSpin:
        """Spin with each side limited to the motors' speed."""
        return WheelSpin(
            min(max(self.left_rad_s, -max_rad_s), max_rad_s),
            min(max(self.right_rad_s, -max_rad_s), max_rad_s),
        )


@dataclass(frozen=True, slots=True)
class WheelTravel:
    """Distance rolled by the wheels of each side."""

    left_m: float
    right_m: float

    @property
    def distance_m(self) -> float:
        """Distance travelled by the centre of the base."""
        return 0.5 * (self.left_m + self.right_m)

    def turn_rad(self, base: DriveBase) -> float:
        """Clockwise turn of a base without slip."""
        return (self.left_m - self.right_m) / base.wheel_separation_m


NO_TRAVEL = WheelTravel(0.0, 0.0)


def wheel_travel(base: DriveBase, spin: WheelSpin, duration_s: float) -> WheelTravel:
    """Travel of spinning wheels as encoders measure, before any slip."""
    # One product: the tachometer divides by the same one, and half of 1.0 prints as 0.5000.
    m_per_rad_s = base.wheel_radius_m * duration_s
    return WheelTravel(m_per_rad_s * spin.left_rad_s, m_per_rad_s * spin.right_rad_s)


def apply_slip(base: DriveBase, travel: WheelTravel, generator: np.random.Generator) -> WheelTravel:
    """Travel over the floor: a fraction of the turn is lost, and each side slips at random."""
    left_noise, right_noise = generator.standard_normal(2)
    lost_m = 0.5 * base.turn_slip * (travel.left_m - travel.right_m)
    # A variance proportional to the travel does not depend on the number of ticks it is cut into.
    left_m, right_m = travel.left_m, travel.right_m
    return WheelTravel(
        left_m - lost_m + base.slip_noise * math.sqrt(abs(left_m)) * float(left_noise),
        right_m + lost_m + base.slip_noise * math.sqrt(abs(right_m)) * float(right_noise),
    )


def integrate_arc(pose: PlanarPose, distance_m: float, turn_rad: float) -> PlanarPose:
    """Pose at the end of an arc of constant curvature, exact, with a straight line as its limit.

    The chord of the arc points along the mean heading; its length is distance * sin(a) / a with
    a = turn / 2.
    """
    half = 0.5 * turn_rad
    # sin(a) / a = 1 - a^2 / 6 + ... is 1 to the last bit of a double below 1e-8.
    chord_m = distance_m * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
    heading_rad = pose.yaw_rad + half
    return PlanarPose(
        pose.x_m + chord_m * math.cos(heading_rad),
        pose.y_m + chord_m * math.sin(heading_rad),
        wrap_angle(pose.yaw_rad + turn_rad),
    )
