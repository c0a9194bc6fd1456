"""Training on the first frames, then a filter from the truth; odometry between readings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_client.frame import Frame
from catoptra_client.landmarks import COLOUR_CODES, label_frame
from catoptra_client.localization import OdometryPose
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_studies.live.live_localizer import (
    NUM_TRAINING_FRAMES,
    LiveLocalizer,
    TimedOdometry,
    interpolate_odometry,
)
from helpers.worlds import make_omni_camera

HEIGHT_M = 0.6
CAMERA = make_omni_camera(width_px=200)
STILL = OdometryPose(0.0, 0.0, 0.0)
FIELD = (
    Landmark("ahead", "beacon", 1.5, 0.5, 0.2, 0.2, 0.2, 0.4, "cyan", "magenta"),
    Landmark("behind", "beacon", -1.2, -0.5, 0.2, 0.2, 0.2, 0.4, "magenta", "yellow"),
)
PALETTE = {"cyan": (0, 200, 200), "magenta": (200, 0, 200), "yellow": (200, 200, 0)}


def make_frame(x_m: float, yaw_rad: float = 0.0) -> Frame:
    """Frame of a robot on the x axis, grey but for the colours of the landmarks."""
    world_from_robot = Pose.from_rpy((x_m, 0.0, -0.1), (0.0, 0.0, yaw_rad))
    robot_from_mirror = Pose.from_rpy((0.0, 0.0, 0.1 - HEIGHT_M))
    rgb = np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, np.uint8)
    labels = label_frame(CAMERA, FIELD, world_from_mirror=world_from_robot @ robot_from_mirror)
    for colour, code in COLOUR_CODES.items():
        rgb[labels == code] = PALETTE[colour]
    return Frame(
        rgb,
        1,
        0.0,
        ImageType.RAW,
        camera_name="Omni",
        time_s=0.0,
        world_from_robot=world_from_robot,
        camera=CAMERA,
        robot_from_mirror=robot_from_mirror,
    )


def train_localizer() -> tuple[LiveLocalizer, list[object]]:
    """A localizer after its training, and the texts of its notes."""
    localizer = LiveLocalizer(FIELD, height_m=HEIGHT_M)
    notes = [localizer.follow(make_frame(0.0), STILL, STILL) for _ in range(NUM_TRAINING_FRAMES)]
    assert all(set(note) == {"text"} for note in notes)
    return localizer, [note["text"] for note in notes]


def test_notes_count_the_training_frames():
    _, texts = train_localizer()
    assert texts[0] == f"training the classifier: 1 of {NUM_TRAINING_FRAMES} labelled frames"
    assert texts[-1] == (
        f"training the classifier: {NUM_TRAINING_FRAMES} of {NUM_TRAINING_FRAMES} labelled frames"
    )


def test_filter_starts_at_the_truth_and_follows_odometry():
    localizer, _ = train_localizer()
    # Odometry has a frame of its own: only its differences count.
    start, end, later = (OdometryPose(x_m, 5.0, 0.0) for x_m in (5.0, 5.3, 5.4))
    begun = localizer.follow(make_frame(1.0), start, start)
    # Grey: a landmark that is seen would correct the odometry.
    unseen = replace(make_frame(1.2), rgb=np.full_like(make_frame(1.2).rgb, 90))
    moved = localizer.follow(unseen, end, later)
    assert begun["pose"] == pytest.approx([1.0, 0.0, 0.0])
    # The belief of now; the text is about the exposure.
    assert moved["pose"] == pytest.approx([1.4, 0.0, 0.0])
    assert str(moved["text"]).startswith("0.10 m from the truth")


def test_training_without_a_colour_goes_on_until_frames_show_it():
    localizer = LiveLocalizer(FIELD, height_m=HEIGHT_M)
    beyond = [make_frame(500.0) for _ in range(NUM_TRAINING_FRAMES)]
    for frame in beyond:
        note = localizer.follow(frame, STILL, STILL)
    assert "no training pixel of: cyan" in str(note["text"])
    assert set(localizer.follow(make_frame(0.0), STILL, STILL)) == {"text"}
    assert "pose" in localizer.follow(make_frame(0.0), STILL, STILL)


def test_truth_has_the_yaw_of_the_pose():
    localizer, _ = train_localizer()
    note = localizer.follow(make_frame(0.0, -2.0), STILL, STILL)
    assert note["pose"] == pytest.approx([0.0, 0.0, -2.0])


def test_world_without_landmarks_is_rejected():
    with pytest.raises(CatoptraError, match="no landmarks"):
        LiveLocalizer((), height_m=HEIGHT_M)


def test_perspective_camera_is_rejected_by_its_name():
    camera = PerspectiveCamera(40, 40, math.radians(60.0))
    frame = replace(make_frame(0.0), camera=camera)
    localizer = LiveLocalizer(FIELD, height_m=HEIGHT_M)
    with pytest.raises(CatoptraError, match="'Omni' is no omnidirectional one"):
        localizer.follow(frame, STILL, STILL)


READINGS = (
    TimedOdometry(1.0, OdometryPose(0.0, 0.0, 3.0)),
    TimedOdometry(1.2, OdometryPose(0.2, -0.1, -3.0)),
    TimedOdometry(1.4, OdometryPose(0.4, 0.0, -2.9)),
)


@pytest.mark.parametrize(
    ("time_s", "expected"),
    [
        (0.5, READINGS[0].pose),
        (1.0, READINGS[0].pose),
        # From 3 rad across pi to -3 rad: the shorter direction.
        (1.075, OdometryPose(0.075, -0.0375, 3.0 + 0.375 * (2.0 * math.pi - 6.0))),
        (1.2, READINGS[1].pose),
        (1.25, OdometryPose(0.25, -0.075, -2.975)),
        (1.4, READINGS[2].pose),
    ],
    ids=["before the oldest", "oldest", "turning", "at a reading", "between", "newest"],
)
def test_odometry_at_a_time(time_s, expected):
    pose = interpolate_odometry(READINGS, time_s)
    assert pose is not None
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx(
        (expected.x_m, expected.y_m, expected.yaw_rad)
    )


def test_time_after_the_newest_reading_has_no_odometry():
    assert interpolate_odometry(READINGS, 1.41) is None
    assert interpolate_odometry((), 1.0) is None
