"""Driving the route round and round in real time, in turn with viewers. Pure functions.

The experiment's controller plans one arc a step and waits for the end. Here the pose is read a few
times a second, each time a command is computed anew, and viewers may have moved the robot.

The server executes the newest command of anyone. The reported wheel speeds are compared with
those commanded here: other ones are a viewer's.

A viewer's wheels win, and the robot returns to its route after 3 s of standing. No message says who
drives, so none can get lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.route import Chassis, Waypoint, WheelCommand, wheel_command_towards

# Half a step of the route: the arc to a nearer waypoint would begin with a sharp turn.
_REACHED_M = 0.1
# A waypoint behind the robot within this distance counts as passed.
_PASSED_M = 0.3
_REACHED_RAD = math.radians(4.0)
# With a waypoint farther to the side the robot turns on the spot: an arc would swing out widely.
_MAX_ARC_BEARING_RAD = math.radians(30.0)


@dataclass(frozen=True, slots=True)
class RouteProgress:
    """Position in the route."""

    index: int = 0
    """Waypoint that the robot drives to."""

    num_laps: int = 0
    """Completed laps."""


def advance_progress(
    progress: RouteProgress, route: Sequence[Waypoint], pose: Waypoint
) -> RouteProgress:
    """Progress to the first waypoint ahead that is not reached yet."""
    # At most one lap: no pose is at all waypoints.
    for _ in route:
        if not _is_at_waypoint(progress, route, pose):
            break
        progress = skip_waypoints(progress, route, 1)
    return progress


def skip_waypoints(
    progress: RouteProgress, route: Sequence[Waypoint], num_waypoints: int
) -> RouteProgress:
    """Progress to a waypoint farther on."""
    laps, index = divmod(progress.index + num_waypoints, len(route))
    return RouteProgress(index, progress.num_laps + laps)


def rejoin_route(
    progress: RouteProgress, route: Sequence[Waypoint], pose: Waypoint
) -> RouteProgress:
    """Progress to the nearest waypoint of the same lap, for a robot that was driven elsewhere."""
    distances_m = [math.hypot(w.x_m - pose.x_m, w.y_m - pose.y_m) for w in route]
    return replace(progress, index=distances_m.index(min(distances_m)))


def steer(
    progress: RouteProgress,
    route: Sequence[Waypoint],
    pose: Waypoint,
    chassis: Chassis,
    *,
    min_duration_s: float,
) -> WheelCommand:
    """Command towards the present waypoint.

    Args:
        progress: Position in the route.
        route: Waypoints.
        pose: True pose of the robot.
        chassis: Dimensions of the robot, and the speed to drive with.
        min_duration_s: Time until the next command: a shorter arc is driven more slowly.
    """
    target = route[progress.index]
    direction_rad = math.atan2(target.y_m - pose.y_m, target.x_m - pose.x_m)
    bearing_rad = wrap_angle(direction_rad - pose.yaw_rad)
    if _is_turn(progress, route):
        target = Waypoint(pose.x_m, pose.y_m, target.yaw_rad)
    elif abs(bearing_rad) > _MAX_ARC_BEARING_RAD:
        target = pose.turn(bearing_rad)
    command = wheel_command_towards(target, pose, chassis)
    slowdown = min(1.0, command.duration_s / min_duration_s)
    return WheelCommand(
        slowdown * command.left_rad_s, slowdown * command.right_rad_s, command.duration_s / slowdown
    )


def _is_at_waypoint(progress: RouteProgress, route: Sequence[Waypoint], pose: Waypoint) -> bool:
    target = route[progress.index]
    if _is_turn(progress, route):
        return abs(wrap_angle(target.yaw_rad - pose.yaw_rad)) < _REACHED_RAD
    dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
    distance_m = math.hypot(dx, dy)
    ahead_m = dx * math.cos(pose.yaw_rad) + dy * math.sin(pose.yaw_rad)
    return distance_m < _REACHED_M or (distance_m < _PASSED_M and ahead_m < 0.0)


def _is_turn(progress: RouteProgress, route: Sequence[Waypoint]) -> bool:
    """Whether the waypoint is a turn at the place of the one before."""
    if progress.index == 0:
        return False
    before, target = route[progress.index - 1], route[progress.index]
    return math.hypot(target.x_m - before.x_m, target.y_m - before.y_m) < _REACHED_M


WheelSpeeds = tuple[float, float]

# A viewer who taps keys, or changes hands, keeps the robot.
RESUME_AFTER_S = 3.0
# The last ones: a state may be older than the newest command.
_NUM_RECENT = 4
_TOLERANCE_RAD_S = 1e-3


@dataclass(frozen=True, slots=True)
class SharedControl:
    """The newest commands, and the latest activity of a viewer."""

    recent_speeds: tuple[WheelSpeeds, ...] = ((0.0, 0.0),)
    """Left and right wheel speeds commanded here, rad/s."""

    foreign_speeds: WheelSpeeds | None = None
    """Wheel speeds of the viewer who drives or has driven last; None where nobody does."""

    foreign_since_s: float = 0.0
    """Time of the viewer's latest activity."""

    @property
    def is_foreign(self) -> bool:
        """Whether a viewer drives, or has stopped a moment ago."""
        return self.foreign_speeds is not None


def record_command(control: SharedControl, speeds: WheelSpeeds) -> SharedControl:
    """Control after a command sent from here."""
    return replace(control, recent_speeds=(*control.recent_speeds, speeds)[-_NUM_RECENT:])


def observe_speeds(control: SharedControl, speeds: WheelSpeeds, time_s: float) -> SharedControl:
    """Control after a look at the robot's wheel speeds.

    A viewer keeps the robot while the wheels turn by other commands than those sent from here, and
    for `RESUME_AFTER_S` from the last change.

    Args:
        control: Control before.
        speeds: Left and right wheel speeds that the server reports, rad/s.
        time_s: Time of a clock.
    """
    if not control.is_foreign:
        if any(_are_equal(speeds, own) for own in control.recent_speeds):
            return control
        return replace(control, foreign_speeds=speeds, foreign_since_s=time_s)
    if any(speeds) or speeds != control.foreign_speeds:
        return replace(control, foreign_speeds=speeds, foreign_since_s=time_s)
    if time_s - control.foreign_since_s < RESUME_AFTER_S:
        return control
    # The viewer's last command was to stand.
    return SharedControl()


def _are_equal(speeds: WheelSpeeds, own: WheelSpeeds) -> bool:
    return all(
        math.isclose(a, b, abs_tol=_TOLERANCE_RAD_S) for a, b in zip(speeds, own, strict=True)
    )
