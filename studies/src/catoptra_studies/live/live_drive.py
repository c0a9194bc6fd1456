"""One robot on a server in real time: driving the route, localization, and the published belief.

The control connection owns the robot and receives the readings, five times a second with the robots
of this repository. The stream has the wheel speeds by which viewers drive and, in another thread,
the frames.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial

from catoptra_client.control_connection import ReplyTimeoutError, ServerAddress
from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.localization import OdometryPose
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import connect_stream
from catoptra_protocol.errors import CatoptraError, ConnectionLostError, DeadlineExceededError
from catoptra_protocol.optics.numerics import angle_difference
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.reports import GroundTruthReading, OdometryReading
from catoptra_studies.experiment.drive_log import read_chassis, read_true_pose, spawn_robot
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.experiment.localization_filter import NOTE_NAME
from catoptra_studies.experiment.route import Waypoint
from catoptra_studies.live.live_localizer import LiveLocalizer, TimedOdometry, interpolate_odometry
from catoptra_studies.live.steering import (
    RouteProgress,
    SharedControl,
    WheelSpeeds,
    advance_progress,
    observe_speeds,
    record_command,
    rejoin_route,
    skip_waypoints,
    steer,
)

ROBOT_NAME = "Live"
# The server may calibrate renderers; Ctrl-C waits for a frame at most so long.
_TIMEOUT_S = 10.0
# A server that is busy with the frames of viewers is no lost one: the control connection ends
# with the server, and the stream's calls may be repeated.
_STREAM_DELAYS = (ConnectionLostError, DeadlineExceededError)
# Readings that have arrived are read at once; later ones belong to the next cycle.
_DRAIN_S = 0.002
# The interval of the readings: the next command follows.
_CYCLE_S = 0.2
# 0.34 m/s: eyes and the motion blur of the camera follow.
_SPEED_FRACTION = 0.6
# A robot that has not moved in this time stands before an obstacle, such as a viewer's robot.
_STUCK_S = 3.0
_STUCK_M = 0.05
_STUCK_RAD = math.radians(5.0)
_BACK_OFF_S = 1.5
_NUM_SKIPPED_WAYPOINTS = 8


class _LiveDrive:
    """A spawned robot and a filter."""

    def __init__(
        self,
        robot: RobotClient,
        stream: StreamClient,
        route: Sequence[Waypoint],
        *,
        request_frame: Callable[[], Future[Frame]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take a spawned robot.

        Args:
            robot: Client of the robot of the name ROBOT_NAME.
            stream: Stream of the same server. Both clients stay the caller's.
            route: Waypoints of one lap.
            request_frame: Requests the newest frame of the robot's first camera, and returns at
                once: the wheels must not wait for a slow frame.
            clock: Source of the time in seconds.

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
        self._route = route
        self._progress = RouteProgress()
        self._control = SharedControl()
        self._request_frame = request_frame
        self._pending_frame = request_frame()
        # 25 seconds: no frame is older.
        self._readings = deque[TimedOdometry](maxlen=128)
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
            self._wait_for_readings()
            self._drive()
            self._localize()

    def _wait_for_readings(self) -> None:
        """Wait for the next readings, and take all that have arrived."""
        self._take_reading(None)
        # A loop that took one a turn would fall behind for good after a pause.
        with suppress(ReplyTimeoutError):
            while True:
                self._take_reading(_DRAIN_S)

    def _take_reading(self, timeout_s: float | None) -> None:
        odometry = self._robot.wait_for_report(OdometryReading, timeout_s)
        # Of the same cycle: the next sensor in the robot files. Odometry itself has no time in the
        # dialect of UT2004.
        time_s = self._robot.wait_for_report(GroundTruthReading).time_s
        pose = OdometryPose(odometry.x_m, odometry.y_m, odometry.yaw_rad)
        self._readings.append(TimedOdometry(time_s, pose))

    def _drive(self) -> None:
        """Command the wheels, unless a viewer does."""
        now_s, pose = self._clock(), read_true_pose(self._robot)
        was_foreign = self._control.is_foreign
        with suppress(*_STREAM_DELAYS):
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
        """Whether the robot stands in spite of commands; asked once a cycle."""
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

    def _localize(self) -> None:
        """Train or localize by the pending frame, publish the result, request the next frame."""
        if not self._pending_frame.done():
            return
        with suppress(*_STREAM_DELAYS):
            frame = self._pending_frame.result()
            assert frame.time_s is not None, "frames of the stream carry a time"
            odometry = interpolate_odometry(self._readings, frame.time_s)
            # Exposed after the newest reading: for the next cycle.
            if odometry is None:
                return
            note = self._localizer.follow(frame, odometry, self._readings[-1].pose)
            if self._control.is_foreign:
                note["text"] = f"driven by a viewer; {note['text']}"
            self._robot.publish(NOTE_NAME, note)
        self._pending_frame = self._request_frame()


@contextmanager
def open_live_drive(
    address: ServerAddress, route: Sequence[Waypoint] = SIM.route
) -> Iterator[_LiveDrive]:
    """Spawn the robot at the start of a route.

    Args:
        address: A server in real time, with a stream.
        route: Waypoints of one lap; by default the paper's.

    Raises:
        CatoptraError: No such server, no robot of that class, or a world without landmarks.
    """
    with (
        connect_stream(address, timeout_s=_TIMEOUT_S) as stream,
        connect_stream(address, timeout_s=_TIMEOUT_S) as frames,
        RobotClient.connect(address.host, address.control_port, _TIMEOUT_S) as robot,
        ThreadPoolExecutor(1, "frames") as pool,
    ):
        spawn_robot(robot, route[0], ROBOT_NAME)
        robot.wait_for_report(GroundTruthReading)
        # A second connection, for one thread.
        get_frame = partial(frames.get_frame, robot=ROBOT_NAME, encoding=ImageEncoding.RAW)
        yield _LiveDrive(robot, stream, route, request_frame=partial(pool.submit, get_frame))
