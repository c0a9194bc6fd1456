"""Recorded drives made by hand: a robot at the origin facing x, and the visible landmarks."""

from __future__ import annotations

import math

import numpy as np

from catoptra_client.frame_sources.stream.stream_client import LandmarkProjection
from catoptra_client.landmarks import Detection
from catoptra_client.localization import OdometryPose
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_studies.degradation.recorded_drive import LabelledFrame, RecordedDrive
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep
from catoptra_studies.experiment.route import Waypoint

NEAR = Landmark("near", "beacon", 1.0, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")
SIDE = Landmark("aside", "beacon", 0.0, 2.0, 0.1, 0.1, 0.2, 0.4, "magenta", "cyan")
FAR = Landmark("far", "beacon", -3.0, 0.0, 0.1, 0.1, 0.2, 0.4, "yellow", "cyan")
FIELD = (NEAR, SIDE, FAR)
CAMERA = camera_with_inscribed_rim(
    PAPER_MIRROR, width_px=40, height_px=40, rim_rad=math.radians(120.0)
)
_STATIONARY_STEP = DriveStep(Waypoint(0.0, 0.0, 0.0), OdometryPose(0.0, 0.0, 0.0), ())


def make_frame(*visible: Landmark) -> LabelledFrame:
    """A black frame in which these landmarks, and no others, are visible."""
    projections = (LandmarkProjection(m, (m.x_m, m.y_m), m in visible, 0.0) for m in FIELD)
    return LabelledFrame(np.zeros((40, 40, 3), np.uint8), tuple(projections))


def make_drive(*frames: LabelledFrame) -> RecordedDrive:
    """A drive in which the robot does not move."""
    steps = (_STATIONARY_STEP,) * (1 + len(frames))
    return RecordedDrive(DriveLog("still", 0, steps), tuple(frames), CAMERA, 0.6)


def make_detection(name: str, range_m: float, bearing_deg: float) -> Detection:
    """Detection of a beacon with a range."""
    bearing = math.radians(bearing_deg)
    return Detection(name, "beacon", range_m, bearing, np.eye(2), 9, True)
