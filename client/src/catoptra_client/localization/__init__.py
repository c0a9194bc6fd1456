"""Localization: an extended Kalman filter over the pose, as functions on immutable beliefs.

One step: `predict` with the control from odometry, `update` with each detected landmark,
`update_health` with the results. Source: Schmits & Visser 2009, Eqs. 4-6.
"""

from catoptra_client.localization.ekf import (
    OPEN_GATE,
    PAPER_GATE,
    BearingOnly,
    Belief,
    Measurement,
    MeasurementUpdate,
    RangeBearing,
    UpdateStatus,
    ValidationGate,
    measurement_from_detection,
    predict,
    update,
)
from catoptra_client.localization.filter_health import (
    FilterHealth,
    Recovery,
    apply_recovery,
    chi_square_mean_interval,
    nees,
    update_health,
)
from catoptra_client.localization.landmark_map import (
    LandmarkMap,
    LandmarkPosition,
    find_landmark_position,
    make_landmark_map,
)
from catoptra_client.localization.motion_model import (
    Control,
    MotionNoise,
    OdometryPose,
    control_from_odometry,
    level_control,
)

__all__ = [
    "OPEN_GATE",
    "PAPER_GATE",
    "BearingOnly",
    "Belief",
    "Control",
    "FilterHealth",
    "LandmarkMap",
    "LandmarkPosition",
    "Measurement",
    "MeasurementUpdate",
    "MotionNoise",
    "OdometryPose",
    "RangeBearing",
    "Recovery",
    "UpdateStatus",
    "ValidationGate",
    "apply_recovery",
    "chi_square_mean_interval",
    "control_from_odometry",
    "find_landmark_position",
    "level_control",
    "make_landmark_map",
    "measurement_from_detection",
    "nees",
    "predict",
    "update",
    "update_health",
]
