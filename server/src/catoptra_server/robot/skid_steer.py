"""How a skid-steered base moves: wheel spin to rolled way, rolled way to a new place.

Both wheels of a side spin alike. Yaw grows clockwise (SAE), so it grows with the left side: (left -
right) / track, as USARSim's odometry integrates it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import DriveBase


@dataclass(frozen=True, slots=True)
class WheelSpin:
    """Commanded spin of the two sides' wheels, rad/s."""

    left_rad_s: float = 0.0
    right_rad_s: float = 0.0

    def clamp(self, max_rad_s: float) -> WheelSpin:
        """Return the spin with each side saturated at the motor's speed."""
        return WheelSpin(
            min(max(self.left_rad_s, -max_rad_s), max_rad_s),
            min(max(self.right_rad_s, -max_rad_s), max_rad_s),
        )


@dataclass(frozen=True, slots=True)
class WheelTravel:
    """The way each side's wheels rolled, in metres."""

    left_m: float
    right_m: float

    @property
    def distance_m(self) -> float:
        """Return the way of the base's middle."""
        return 0.5 * (self.left_m + self.right_m)

    def turn_rad(self, base: DriveBase) -> float:
        """Return the clockwise turn of a base that does not slip."""
        return (self.left_m - self.right_m) / base.wheel_separation_m


NO_TRAVEL = WheelTravel(0.0, 0.0)


def wheel_travel(base: DriveBase, spin: WheelSpin, duration_s: float) -> WheelTravel:
    """Return what the wheels roll in a time: what encoders see, whatever the floor does."""
    way = base.wheel_radius_m * duration_s
    return WheelTravel(way * spin.left_rad_s, way * spin.right_rad_s)


def apply_slip(base: DriveBase, travel: WheelTravel, generator: np.random.Generator) -> WheelTravel:
    """Return what the floor makes of a rolled way: a part of the turn lost, and random slip.

    The random slip of a side has a variance in proportion to its way, so that it does not depend on
    how the way is cut into ticks.
    """
    left_noise, right_noise = generator.standard_normal(2)
    lost = 0.5 * base.turn_slip * (travel.left_m - travel.right_m)
    return WheelTravel(
        travel.left_m - lost + base.slip_noise * math.sqrt(abs(travel.left_m)) * float(left_noise),
        travel.right_m
        + lost
        + base.slip_noise * math.sqrt(abs(travel.right_m)) * float(right_noise),
    )


def integrate_arc(pose: PlanarPose, distance_m: float, turn_rad: float) -> PlanarPose:
    """Return where a base ends that drives an arc: exact, and regular for a straight one.

    The chord of the arc points along the mean heading; its length is distance * sin(a) / a, a =
    turn / 2.
    """
    half = 0.5 * turn_rad
    # The quotient tends to 1, which is its value as a double below 1e-8.
    chord = distance_m * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
    heading = pose.yaw_rad + half
    return PlanarPose(
        pose.x_m + chord * math.cos(heading),
        pose.y_m + chord * math.sin(heading),
        wrap_angle(pose.yaw_rad + turn_rad),
    )
