"""Hard cases of the motion model: turns of zero, tiny, many; steps of nothing and backwards."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_client.localization import motion_model
from catoptra_client.localization.motion_model import Control, MotionNoise
from stability.catalogue import Subject


def _noise(v: float, turn: float, alphas: list[float]) -> Any:
    return np.diagonal(motion_model.control_covariance(Control(v, turn), MotionNoise(*alphas)))


def _control(start: list[float], end: list[float]) -> list[float]:
    poses = motion_model.OdometryPose(*start), motion_model.OdometryPose(*end)
    control = motion_model.control_from_odometry(*poses)
    return [control.distance_m, control.turn_rad]


SUBJECTS: dict[str, Subject] = {
    "position": lambda pose, v, turn: motion_model.propagate_pose(np.array(pose), Control(v, turn))[
        :2
    ],
    "heading": lambda pose, v, turn: motion_model.propagate_pose(np.array(pose), Control(v, turn))[
        2
    ],
    "by_pose": lambda pose, v, turn: motion_model.jacobian_wrt_pose(
        np.array(pose), Control(v, turn)
    )[:2, 2],
    "by_control": lambda pose, v, turn: motion_model.jacobian_wrt_control(
        np.array(pose), Control(v, turn)
    )[:2],
    "chord_over_arc_slope": lambda a: motion_model.chord_over_arc_derivative(a),
    "control_from_odometry": _control,
    "noise": _noise,
}
