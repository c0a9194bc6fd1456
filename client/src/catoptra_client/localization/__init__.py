"""Localisation: an extended Kalman filter over the pose, as functions on immutable beliefs.

One step: `predict` with the control from odometry, `update` with each landmark seen, `update_health` what
became of them. Source: Schmits & Visser 2009, Eqs. 4-6.
"""

from catoptra_client.localization.belief import Belief
from catoptra_client.localization.consistency import chi_square_mean_interval, nees
from catoptra_client.localization.ekf import UpdateStatus, MeasurementUpdate, predict, update
from catoptra_client.localization.gate import OPEN_GATE, PAPER_GATE, ValidationGate
from catoptra_client.localization.landmark_map import (
    LandmarkMap,
    LandmarkPosition,
    make_landmark_map,
    find_landmark_position,
)
from catoptra_client.localization.measurement import (
    BearingOnly,
    Measurement,
    RangeBearing,
    measurement_from_detection,
)
from catoptra_client.localization.monitor import FilterHealth, Recovery, update_health, apply_recovery
from catoptra_client.localization.motion import Control, MotionNoise
from catoptra_client.localization.odometry import OdometryPose, control_from_odometry

__all__ = [
    "OPEN_GATE",
    "PAPER_GATE",
    "BearingOnly",
    "Belief",
    "Control",
    "FilterHealth",
    "ValidationGate",
    "LandmarkMap",
    "LandmarkPosition",
    "Measurement",
    "MotionNoise",
    "OdometryPose",
    "RangeBearing",
    "UpdateStatus",
    "Recovery",
    "MeasurementUpdate",
    "control_from_odometry",
    "make_landmark_map",
    "chi_square_mean_interval",
    "measurement_from_detection",
    "nees",
    "update_health",
    "find_landmark_position",
    "predict",
    "apply_recovery",
    "update",
]
