"""Localization of a robot from a camera's frames, after a training on the first ones.

Each frame carries the pose of its exposure. In the training this pose labels the pixels; later
the note compares the belief with this truth, which no filter reads.

A frame arrives tens of milliseconds after the exposure, on a busy machine a second, and in the
turns of the route 50 ms are 4 degrees. So odometry is interpolated to the time of the exposure.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

from catoptra_client.frame import Frame
from catoptra_client.landmarks import Detector, Viewpoint, detect, label_frame, make_detector, train
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.localization import (
    OdometryPose,
    control_from_odometry,
    make_landmark_map,
    predict,
)
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import angle_difference, wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_studies.experiment.drive_log import DriveStep, measurements_in_range
from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER
from catoptra_studies.experiment.localization_filter import (
    FilterStep,
    advance_filter,
    begin_filter,
    belief_entries,
    note_from_filter_step,
)
from catoptra_studies.experiment.route import Waypoint

# Two seconds of the drive. Of the 142 landmarks that are near in one round, a classifier of 2 to 8
# frames measures 136, and one of 12 or of the 30 random poses of `demo` 141.
NUM_TRAINING_FRAMES = 6
# The consistent filter, which no wrong belief locks out for good: viewers move the robot.
_LIVE_FILTER = replace(CONSISTENT_FILTER, name="live", has_recovery=True)


class LiveLocalizer:
    """A classifier in training, then a filter; one frame of the robot's camera a step."""

    def __init__(self, landmarks: Sequence[Landmark], *, height_m: float) -> None:
        """Begin with the training.

        Args:
            landmarks: Landmarks of the world.
            height_m: Height of the camera's viewpoint above the floor.

        Raises:
            CatoptraError: The world has no landmarks.
        """
        if not landmarks:
            raise CatoptraError("the world has no landmarks: nothing to localize the robot by")
        self._landmarks = tuple(landmarks)
        self._map = make_landmark_map(self._landmarks)
        self._viewpoint = Viewpoint(height_m)
        self._labelled_frames = deque[tuple[UInt8Array, UInt8Array]](maxlen=NUM_TRAINING_FRAMES)
        self._detector: Detector | None = None
        self.latest: FilterStep | None = None
        """Latest step of the filter; None while the classifier is trained."""

    def follow(
        self, frame: Frame, odometry: OdometryPose, newest_odometry: OdometryPose
    ) -> dict[str, object]:
        """Train or localize by one frame.

        Args:
            frame: Frame of the robot's omnidirectional camera, from the stream.
            odometry: Odometry at the exposure.
            newest_odometry: Odometry since then.

        Returns:
            The note for the robot's viewers: the belief of now, and the detections of the frame.
        """
        if self._detector is None:
            return self._train(frame)
        truth = _waypoint(_require_pose(frame))
        if self.latest is None:
            start = DriveStep(truth, odometry, ())
            self.latest = begin_filter(start, _LIVE_FILTER, heading_error_rad=0.0)
        else:
            measurements = measurements_in_range(detect(self._detector, frame.rgb))
            step = DriveStep(truth, odometry, measurements)
            self.latest = advance_filter(self.latest, step, _LIVE_FILTER, self._map)
        note = note_from_filter_step(self.latest)
        since = control_from_odometry(odometry, newest_odometry)
        now = predict(self.latest.belief, since, noise=_LIVE_FILTER.motion_noise)
        return note | belief_entries(now)

    def _train(self, frame: Frame) -> dict[str, object]:
        camera = _require_omni_camera(frame)
        mirror = _require_pose(frame) @ (frame.robot_from_mirror or Pose.identity())
        labels = label_frame(camera, self._landmarks, world_from_mirror=mirror)
        self._labelled_frames.append((frame.rgb, labels))
        num_frames = len(self._labelled_frames)
        text = f"training the classifier: {num_frames} of {NUM_TRAINING_FRAMES} labelled frames"
        if num_frames == NUM_TRAINING_FRAMES:
            try:
                self._detector = make_detector(
                    camera,
                    train(self._labelled_frames),
                    landmarks=self._landmarks,
                    viewpoint=self._viewpoint,
                )
            except DomainError as error:
                # A colour that no frame shows: the next frame takes the place of the oldest.
                text = f"training the classifier: {error}"
        return {"text": text}


def _require_omni_camera(frame: Frame) -> OmniCamera:
    if isinstance(frame.camera, OmniCamera):
        return frame.camera
    raise CatoptraError(
        f"camera {frame.camera_name!r} is no omnidirectional one: name a robot file whose first "
        "camera is, such as p2at_omni_sim"
    )


def _require_pose(frame: Frame) -> Pose:
    assert frame.world_from_robot is not None, "frames of the stream carry a pose"
    return frame.world_from_robot


def _waypoint(world_from_robot: Pose) -> Waypoint:
    x_m, y_m, _ = world_from_robot.translation
    forward = world_from_robot.rotation[:, 0]
    return Waypoint(float(x_m), float(y_m), math.atan2(forward[1], forward[0]))


@dataclass(frozen=True, slots=True)
class TimedOdometry:
    """One reading."""

    time_s: float
    """Simulation time."""

    pose: OdometryPose


def interpolate_odometry(readings: Sequence[TimedOdometry], time_s: float) -> OdometryPose | None:
    """Odometry at a time, on the straight line between two readings.

    Args:
        readings: Readings, the oldest first.
        time_s: Simulation time; before the oldest reading, that one counts.

    Returns:
        The pose; None after the newest reading.
    """
    index = bisect_left(readings, time_s, key=lambda reading: reading.time_s)
    if index == len(readings):
        return None
    after = readings[index]
    if index == 0:
        return after.pose
    before = readings[index - 1]
    fraction = (time_s - before.time_s) / (after.time_s - before.time_s)
    turn_rad = angle_difference(after.pose.yaw_rad, before.pose.yaw_rad)
    return OdometryPose(
        before.pose.x_m + fraction * (after.pose.x_m - before.pose.x_m),
        before.pose.y_m + fraction * (after.pose.y_m - before.pose.y_m),
        wrap_angle(before.pose.yaw_rad + fraction * turn_rad),
    )
