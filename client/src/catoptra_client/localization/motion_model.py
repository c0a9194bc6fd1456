"""Motion model: propagation of a pose and its uncertainty by one control, and controls of odometry.

State (x, y, phi) in the world frame, control u = (v, delta phi) per step (Schmits & Visser 2009,
Eqs. 4 and 5). With a = delta phi / 2 and S = sin(a) / a the robot follows a circular arc of length
v: the velocity motion model of Thrun, Burgard & Fox 2005 (table 5.3), in a form that is regular
without a turn, where v / omega is not. A control comes from two odometry poses, which are in a
frame of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, angle_difference, wrap_angle

# S'(a) = sum over n >= 1 of (-1)^n 2n / (2n + 1)! a^(2n-1). Ten terms reach 1e-18 at |a| = 1.
_DERIVATIVE_COEFFICIENTS = tuple(
    (-1.0) ** n * 2 * n / math.factorial(2 * n + 1) for n in range(1, 11)
)
# The closed form of S' loses a relative 3 eps / a^2, which is rounding from 1 rad on.
_SERIES_LIMIT_RAD = 1.0


@dataclass(frozen=True, slots=True)
class Control:
    """Motion of the robot in one step."""

    distance_m: float
    """Arc length; negative backwards."""
    turn_rad: float
    """Turn, positive to the right."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.distance_m) and math.isfinite(self.turn_rad)):
            raise DomainError(f"a control must be finite: {self.distance_m!r}, {self.turn_rad!r}")


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Noise parameters: variances per squared metre driven and per squared radian turned.

    The variance of v is alpha1 v^2 + alpha2 dphi^2, that of dphi alpha3 v^2 + alpha4 dphi^2.
    """

    alpha1: float
    """Distance variance per squared distance; no unit."""
    alpha2: float
    """Distance variance per squared turn, m^2 / rad^2."""
    alpha3: float
    """Turn variance per squared distance, rad^2 / m^2."""
    alpha4: float
    """Turn variance per squared turn; no unit."""

    def __post_init__(self) -> None:
        alphas = (self.alpha1, self.alpha2, self.alpha3, self.alpha4)
        if not all(math.isfinite(alpha) and alpha >= 0.0 for alpha in alphas):
            raise DomainError(f"the alphas are variances, finite and not negative: {alphas}")


def chord_over_arc(half_turn_rad: float) -> float:
    """Ratio of chord to arc, S = sin(a) / a, with the limit 1 at 0."""
    # sin(a) / a is exact to rounding for any a but 0: no series is needed.
    return math.sin(half_turn_rad) / half_turn_rad if half_turn_rad else 1.0


def chord_over_arc_derivative(half_turn_rad: float) -> float:
    """Derivative dS/da = (a cos(a) - sin(a)) / a^2, by a series where the terms cancel."""
    a = half_turn_rad
    if abs(a) >= _SERIES_LIMIT_RAD:
        return (math.cos(a) - math.sin(a) / a) / a
    # Horner's scheme in a^2.
    total = 0.0
    for coefficient in reversed(_DERIVATIVE_COEFFICIENTS):
        total = total * a * a + coefficient
    return total * a


def propagate_pose(pose: Floats, control: Control) -> Floats:
    """Pose (3,) after one control; phi wrapped."""
    # The chord of an arc points along the mean heading of the step.
    half_turn = 0.5 * control.turn_rad
    chord = control.distance_m * chord_over_arc(half_turn)
    heading = pose[2] + half_turn
    return np.array(
        [
            pose[0] + chord * math.cos(heading),
            pose[1] + chord * math.sin(heading),
            wrap_angle(float(pose[2]) + control.turn_rad),
        ]
    )


def jacobian_wrt_pose(pose: Floats, control: Control) -> Floats:
    """Jacobian G (3, 3) of `propagate_pose` with respect to the (3,) pose."""
    half_turn = 0.5 * control.turn_rad
    chord = control.distance_m * chord_over_arc(half_turn)
    heading = pose[2] + half_turn
    return np.array(
        [
            [1.0, 0.0, -chord * math.sin(heading)],
            [0.0, 1.0, chord * math.cos(heading)],
            [0.0, 0.0, 1.0],
        ]
    )


def jacobian_wrt_control(pose: Floats, control: Control) -> Floats:
    """Jacobian V (3, 2) of `propagate_pose` with respect to (v, delta phi)."""
    a = 0.5 * control.turn_rad
    ratio, slope = chord_over_arc(a), chord_over_arc_derivative(a)
    cos_h, sin_h = math.cos(pose[2] + a), math.sin(pose[2] + a)
    half_v = 0.5 * control.distance_m
    return np.array(
        [
            [ratio * cos_h, half_v * (slope * cos_h - ratio * sin_h)],
            [ratio * sin_h, half_v * (slope * sin_h + ratio * cos_h)],
            [0.0, 1.0],
        ]
    )


def control_covariance(control: Control, noise: MotionNoise) -> Floats:
    """Covariance M (2, 2) of (v, delta phi) in one step; zero for a robot at rest.

    Infinite for a control whose square exceeds float64.
    """
    # Products, because Python's ** raises OverflowError where a product gives inf.
    v2, turn2 = control.distance_m * control.distance_m, control.turn_rad * control.turn_rad
    return np.diag(
        [noise.alpha1 * v2 + noise.alpha2 * turn2, noise.alpha3 * v2 + noise.alpha4 * turn2]
    )


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


def level_control(control: Control, *, roll_rad: float, pitch_rad: float) -> Control:
    """Control on the level plane of what a tilted robot drives on its own.

    (v cos(pitch), delta phi cos(roll) / cos(pitch)): the share of the driving direction that is
    level, and the rate of the heading for a turn about the robot's z axis. Both are rates; over a
    step take the mean attitude. |pitch| is below 90 degrees.
    """
    level = math.cos(pitch_rad)
    return Control(control.distance_m * level, control.turn_rad * math.cos(roll_rad) / level)
