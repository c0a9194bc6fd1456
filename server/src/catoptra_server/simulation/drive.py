"""Motion of a skid-steered base for one tick: wheel spin to wheel travel to a new pose.

Both wheels of a side spin alike. Yaw grows clockwise (SAE), hence with the travel of the left side:
turn = (left - right) / track, as USARSim's odometry integrates wheel rotations. Slip is random, by
tick; the base stops at the first contact while the wheels roll on.

Bases of USARSim's robots are here, too: robot files leave them to the source of the class. UT2004
P2AT and UDK P3AT are from replies of real servers. No reply of the P2DX's class is public: wheels
and body are from the manufacturer's data sheet of the Pioneer 2-DX, and the wheel speed gives the
driving speed of the _P2AT. Ride heights are our choice: half the body's height.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, PlanarPose


@dataclass(frozen=True, slots=True)
class WheelSpin:
    """Commanded spin of the wheels of each side."""

    left_rad_s: float = 0.0
    right_rad_s: float = 0.0

    def limit_to(self, max_rad_s: float) -> WheelSpin:
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


@dataclass(frozen=True, slots=True, eq=False)
class RobotBody:
    """State of a base."""

    base: DriveBase
    pose: PlanarPose
    """Place and heading from above."""
    world_from_robot: Pose
    """Pose of the chassis frame."""
    spin: WheelSpin = WheelSpin()
    height_m: float = 0.0
    """Height above the wheels' plane up to which the robot meets things, if above its body's."""
    tick: int = 0
    """Number of ticks simulated; index of the random slip."""
    footing: object = None
    """What its ground remembers of it."""
    is_settled: bool = False
    """Whether it lies still as long as no wheel turns."""
    is_flipping: bool = False
    """Whether it is to be turned onto its wheels in the next tick, where there is room."""
    mishap: str = ""
    """In words, how it lies after a fall; empty for a base on its wheels."""

    @classmethod
    def on_floor(cls, base: DriveBase, pose: PlanarPose, height_m: float = 0.0) -> RobotBody:
        """Base on the plane z = 0."""
        return cls(base, pose, pose.at_height(base.ride_height_m), height_m=height_m)


class MoveBase(Protocol):
    """The ground: moves a base on what it stands on, until something stops it."""

    def __call__(self, body: RobotBody, travel: WheelTravel, duration_s: float) -> RobotBody:
        """Base after some seconds in which its wheels travelled over the surface."""


def step_body(
    body: RobotBody, duration_s: float, *, move: MoveBase, random_source: RandomSource
) -> tuple[RobotBody, WheelTravel]:
    """Move a base by one tick.

    Where the ground stops the base the wheels roll on, as encoders of a blocked robot measure.

    Args:
        random_source: Source of the random slip.

    Returns:
        The base after the tick, and the travel of the wheels before slip, as encoders measure it.
    """
    # One product: the tachometer divides by the same one, and half of 1.0 prints as 0.5000.
    m_per_rad_s = body.base.wheel_radius_m * duration_s
    travel = WheelTravel(m_per_rad_s * body.spin.left_rad_s, m_per_rad_s * body.spin.right_rad_s)
    travel_on_floor = travel
    if travel != NO_TRAVEL:
        # Random numbers by tick: a drive repeats itself whatever other robots do.
        noise = [0.0, 0.0]
        if body.base.slip_noise:
            noise = random_source.normal_variates(body.tick, 2)
        travel_on_floor = _apply_slip(body.base, travel, noise)
    moved = move(body, travel_on_floor, duration_s)
    return replace(moved, tick=body.tick + 1), travel


def _apply_slip(base: DriveBase, travel: WheelTravel, noise: list[float]) -> WheelTravel:
    """Travel over the floor: a fraction of the turn is lost, and each side slips at random."""
    left_noise, right_noise = noise
    lost_m = 0.5 * base.turn_slip * (travel.left_m - travel.right_m)
    # A variance proportional to the travel does not depend on the number of ticks in between.
    left_m, right_m = travel.left_m, travel.right_m
    return WheelTravel(
        left_m - lost_m + base.slip_noise * math.sqrt(abs(left_m)) * left_noise,
        right_m + lost_m + base.slip_noise * math.sqrt(abs(right_m)) * right_noise,
    )


def integrate_arc(pose: PlanarPose, distance_m: float, turn_rad: float) -> PlanarPose:
    """Pose at the end of an arc of constant curvature, exact, with a straight line as the limit.

    The chord of the arc points along the mean heading; its length is distance * sin(a) / a with
    a = turn / 2.
    """
    half = 0.5 * turn_rad
    # sin(a) / a = 1 - a^2 / 6 + ... is 1 to the last bit of a double below 1e-8.
    chord_m = distance_m * (sin(half) / half if abs(half) > 1e-8 else 1.0)
    heading_rad = pose.yaw_rad + half
    return PlanarPose(
        pose.x_m + chord_m * cos(heading_rad),
        pose.y_m + chord_m * sin(heading_rad),
        wrap_angle(pose.yaw_rad + turn_rad),
    )


_P2AT = DriveBase(
    wheel_radius_m=0.13,
    wheel_separation_m=0.4712,
    wheel_base_m=0.2884,
    dimensions_m=(0.5238, 0.4968, 0.2913),
    ride_height_m=0.1457,
    mass_kg=14.0,
    max_speed_rad_s=5.385,
    max_torque=60.0,
    turn_slip=0.0,
    slip_noise=0.0,
)
_P2DX = replace(
    _P2AT,
    wheel_radius_m=0.0955,
    wheel_separation_m=0.33,
    wheel_base_m=0.185,  # from the driven axle to the castor's
    dimensions_m=(0.44, 0.38, 0.22),
    ride_height_m=0.11,
    mass_kg=9.0,
    max_speed_rad_s=7.33,  # 0.70 m/s on these wheels, as the P2AT's 5.385 on larger ones
)
_P3AT = DriveBase(
    wheel_radius_m=0.098,
    wheel_separation_m=0.36,
    wheel_base_m=0.248,
    # UDK reports wheel base, track and 0 here, which is no body to collide with.
    dimensions_m=(0.248, 0.36, 0.0),
    collision_dimensions_m=(0.508, 0.497, 0.277),  # the manufacturer's data sheet
    ride_height_m=0.1385,
    mass_kg=11.9,
    max_speed_rad_s=1.3,
    max_torque=50000.0,
    turn_slip=0.0,
    slip_noise=0.0,
)
# Of cameras without a robot. No wheel turns: the lengths keep odometry's divisions defined.
TRIPOD = replace(_P2AT, ride_height_m=0.0, mass_kg=0.0, max_speed_rad_s=0.0, is_tripod=True)
# By the name of the class without its package, in lower case.
STANDARD_BASES = {"p2at": _P2AT, "omnip2at": _P2AT, "p2dx": _P2DX, "omnip2dx": _P2DX, "p3at": _P3AT}
