"""Localisation: an extended Kalman filter over the pose, as functions on immutable beliefs.

One step: `predict` with the control from odometry, `update` with each landmark seen, `observe` what
became of them. Source: Schmits & Visser 2009, Eqs. 4-6.
"""

from catoptra_client.localization.belief import Belief
from catoptra_client.localization.consistency import mean_interval, nees
from catoptra_client.localization.ekf import Reason, Update, predict, update
from catoptra_client.localization.gate import OPEN_GATE, PAPER_GATE, Gate
from catoptra_client.localization.landmark_map import (
    LandmarkMap,
    LandmarkPosition,
    landmark_map,
    position_of,
)
from catoptra_client.localization.measurement import (
    BearingOnly,
    Measurement,
    RangeBearing,
    measurement_from_detection,
)
from catoptra_client.localization.monitor import FilterHealth, Recovery, observe, recovered
from catoptra_client.localization.motion import Control, MotionNoise
from catoptra_client.localization.odometry import OdometryPose, control_from_odometry

__all__ = [
    "OPEN_GATE",
    "PAPER_GATE",
    "BearingOnly",
    "Belief",
    "Control",
    "FilterHealth",
    "Gate",
    "LandmarkMap",
    "LandmarkPosition",
    "Measurement",
    "MotionNoise",
    "OdometryPose",
    "RangeBearing",
    "Reason",
    "Recovery",
    "Update",
    "control_from_odometry",
    "landmark_map",
    "mean_interval",
    "measurement_from_detection",
    "nees",
    "observe",
    "position_of",
    "predict",
    "recovered",
    "update",
]
