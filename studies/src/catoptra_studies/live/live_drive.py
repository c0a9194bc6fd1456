"""One robot on a server in real time: it drives the route, localizes itself, publishes its belief.

The control connection owns the robot and receives its readings, five times a second with the robots
of this repository; the stream has its frames, and the wheel speeds by which viewers drive it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from catoptra_client.control_connection import ReplyTimeoutError
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.localization import OdometryPose
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_address import ServerAddress
from catoptra_client.training_frames import ROBOT_CLASS
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import angle_difference
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.reports import GroundTruthReading
from catoptra_studies.experiment.drive_log import (
    read_chassis,
    read_odometry_pose,
    read_true_pose,
)
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.experiment.filter_note import NOTE_NAME
from catoptra_studies.experiment.route import Waypoint
from catoptra_studies.live.live_localizer import LiveLocalizer
from catoptra_studies.live.route_progress import (
    RouteProgress,
    advance_progress,
    rejoin_route,
    skip_waypoints,
    steer,
)
from catoptra_studies.live.shared_control import (
    SharedControl,
    WheelSpeeds,
    observe_speeds,
    record_command,
)

ROBOT_NAME = "Live"
# The server may calibrate renderers, and page and filter share its frames.
_TIMEOUT_S = 20.0
# Readings that have arrived are read at once; later ones belong to the next cycle.
_DRAIN_S = 0.002
# The interval of the readings: the next command follows with them.
_CYCLE_S = 0.2
# 0.34 m/s: eyes and the motion blur of the camera follow.
_SPEED_FRACTION = 0.6
# A robot that has not moved in this time stands before an obstacle, such as a viewer's robot.
_STUCK_S = 3.0
_STUCK_M = 0.05
_STUCK_RAD = math.radians(5.0)
_BACK_OFF_S = 1.5
_NUM_SKIPPED_WAYPOINTS = 8


@dataclass(frozen=True, slots=True)
class _Odometry:
    """A reading, and the time that the server states for its cycle."""

    time_s: float
    pose: OdometryPose


class LiveDrive:
    """A spawned robot and its filter."""

    def __init__(
        self,
        robot: RobotClient,
        stream: StreamClient,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take a spawned robot of the name ROBOT_NAME; its clients stay the caller's.

        Raises:
            CatoptraError: The world has no landmarks.
        """
        self._robot = robot
        self._stream = stream
        self._clock = clock
        chassis = read_chassis(robot)
        self._chassis = replace(chassis, max_speed_rad_s=_SPEED_FRACTION * chassis.max_speed_rad_s)
        height_m = robot.get_camera_and_height()[1]
        self._localizer = LiveLocalizer(stream.get_landmarks(), height_m=height_m)
        self._route = SIM.route
        self._progress = RouteProgress()
        self._control = SharedControl()
        self._odometry: _Odometry | None = None
        self._moved = (clock(), read_true_pose(robot))
        self._back_off_until_s = 0.0

    def run(self, num_laps: int | None) -> None:
        """Drive and localize, for ever or until a number of laps is completed.

        Raises:
            ConnectionLostError: The server has ended.
            CatoptraError: The robot has no omnidirectional camera.
        """
        self._robot.share_control()
        while num_laps is None or self._progress.num_laps < num_laps:
            time_s = self._wait_for_newest_readings()
            self._drive()
            self._localize(time_s)

    def _wait_for_newest_readings(self) -> float:
        """Wait for the next readings, and skip older ones that were not read in time.

        Returns:
            Simulation time of the readings.
        """
        reading = self._robot.wait_for_report(GroundTruthReading)
        while True:
            try:
                reading = self._robot.wait_for_report(GroundTruthReading, timeout_s=_DRAIN_S)
            except ReplyTimeoutError:
                return reading.time_s

    def _drive(self) -> None:
        """Command the wheels, unless a viewer does."""
        now_s, pose = self._clock(), read_true_pose(self._robot)
        was_foreign = self._control.is_foreign
        self._control = observe_speeds(self._control, self._read_wheel_speeds(), now_s)
        if self._control.is_foreign:
            self._moved = now_s, pose
            return
        if was_foreign:
            self._progress = rejoin_route(self._progress, self._route, pose)
        self._progress = advance_progress(self._progress, self._route, pose)
        if self._is_stuck(now_s, pose):
            self._progress = skip_waypoints(self._progress, self._route, _NUM_SKIPPED_WAYPOINTS)
            self._back_off_until_s = now_s + _BACK_OFF_S
        speeds = self._choose_speeds(now_s, pose)
        self._robot.drive(*speeds)
        self._control = record_command(self._control, speeds)

    def _choose_speeds(self, now_s: float, pose: Waypoint) -> WheelSpeeds:
        if now_s < self._back_off_until_s:
            back_rad_s = -0.5 * self._chassis.max_speed_rad_s
            return back_rad_s, back_rad_s
        command = steer(self._progress, self._route, pose, self._chassis, min_duration_s=_CYCLE_S)
        return command.left_rad_s, command.right_rad_s

    def _is_stuck(self, now_s: float, pose: Waypoint) -> bool:
        """Whether the robot stands although it is driven; asked once a cycle."""
        since_s, before = self._moved
        distance_m = math.hypot(pose.x_m - before.x_m, pose.y_m - before.y_m)
        turn_rad = abs(angle_difference(pose.yaw_rad, before.yaw_rad))
        if distance_m > _STUCK_M or turn_rad > _STUCK_RAD:
            self._moved = now_s, pose
            return False
        if now_s - since_s < _STUCK_S:
            return False
        self._moved = now_s, pose
        return True

    def _read_wheel_speeds(self) -> WheelSpeeds:
        for robot in self._stream.get_state(ROBOT_NAME).robots:
            if robot.name == ROBOT_NAME:
                return robot.wheel_speeds_rad_s
        raise CatoptraError(f"robot {ROBOT_NAME!r} has left the world: see the server's log")

    def _localize(self, time_s: float) -> None:
        """Train or localize by a frame, and publish the result."""
        previous, newest = self._odometry, _Odometry(time_s, read_odometry_pose(self._robot))
        self._odometry = newest
        frame = self._stream.get_frame(robot=ROBOT_NAME, encoding=ImageEncoding.RAW)
        assert frame.time_s is not None, "frames of the stream carry a time"
        odometry = _extrapolate(previous or newest, newest, frame.time_s)
        note = self._localizer.follow(frame, odometry)
        if self._control.is_foreign:
            note["text"] = f"driven by a viewer; {note['text']}"
        self._robot.publish(NOTE_NAME, note)


@contextmanager
def open_live_drive(address: ServerAddress) -> Iterator[LiveDrive]:
    """Spawn the robot at the start of the route.

    Args:
        address: A server in real time, with a stream.

    Raises:
        CatoptraError: No such server, no robot of that class, or a world without landmarks.
    """
    assert address.stream_port is not None, "the servers started here have a stream"
    start = SIM.route[0]
    with (
        StreamClient.connect(address.host, address.stream_port, _TIMEOUT_S) as stream,
        RobotClient.connect(address.host, address.control_port, _TIMEOUT_S) as robot,
    ):
        robot.spawn(
            ROBOT_CLASS,
            name=ROBOT_NAME,
            location_m=(start.x_m, start.y_m, 0.0),
            rotation_rad=(0.0, 0.0, start.yaw_rad),
        )
        robot.wait_for_report(GroundTruthReading)
        yield LiveDrive(robot, stream)


def _extrapolate(previous: _Odometry, newest: _Odometry, time_s: float) -> OdometryPose:
    """Odometry at a time shortly after the newest reading, by the velocity before it."""
    interval_s = newest.time_s - previous.time_s
    # At most one interval: a frame that comes later still says nothing about the velocity.
    after_s = min(max(time_s - newest.time_s, 0.0), max(interval_s, 0.0))
    if after_s == 0.0:
        return newest.pose
    fraction, old, new = after_s / interval_s, previous.pose, newest.pose
    return OdometryPose(
        new.x_m + fraction * (new.x_m - old.x_m),
        new.y_m + fraction * (new.y_m - old.y_m),
        new.yaw_rad + fraction * angle_difference(new.yaw_rad, old.yaw_rad),
    )
