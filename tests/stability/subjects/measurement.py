"""Hard cases of the measurement model: a landmark at the robot, behind it, out of reach."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_client.localization import LandmarkPosition, RangeBearing, ekf
from stability.catalogue import Invalid, Subject


def _predict(pose: list[float], landmark: list[float]) -> ekf.PredictedMeasurement:
    expected, valid = ekf.predict_measurement(np.array(pose), LandmarkPosition("l", *landmark))
    if not valid:
        raise Invalid("no expectation")
    return expected


def _innovation(pose: list[float], landmark: list[float], measured: list[float]) -> Any:
    seen = RangeBearing(*measured, np.eye(2))
    return ekf.compute_innovation(seen, _predict(pose, landmark))[0]


SUBJECTS: dict[str, Subject] = {
    "range": lambda pose, landmark: _predict(pose, landmark).range_m,
    "bearing": lambda pose, landmark: _predict(pose, landmark).bearing_rad,
    "jacobian": lambda pose, landmark: _predict(pose, landmark).jacobian[:, :2],
    "innovation": _innovation,
}
