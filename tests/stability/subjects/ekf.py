"""Hard cases of the filter: one update, a sequence of updates, one prediction; rejections."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_client.localization import (
    OPEN_GATE,
    Belief,
    Control,
    LandmarkPosition,
    MotionNoise,
    RangeBearing,
    ekf,
)
from stability.catalogue import Invalid, Subject


def _run_update(
    mean: list[float], covariance: list[list[float]], seen: list[list[float]]
) -> Belief:
    belief = Belief(np.array(mean), np.array(covariance))
    for x, y, r, gamma, r11, r12, r22 in seen:
        measured = RangeBearing(r, gamma, np.array([[r11, r12], [r12, r22]]))
        landmark = LandmarkPosition("l", x, y)
        result = ekf.update(belief, measured, landmark=landmark, gate=OPEN_GATE)
        if not result.is_accepted:
            raise Invalid(result.status)
        belief = result.belief
    return belief


def _run_prediction(
    mean: Any, covariance: Any, v: float, turn: float, alphas: list[float]
) -> Belief:
    belief = Belief(np.array(mean), np.array(covariance))
    return ekf.predict(belief, Control(v, turn), noise=MotionNoise(*alphas))


def _square_root(covariance: Any) -> Belief:
    """Belief of the square of a covariance's root."""
    root, valid = ekf.covariance_square_root(np.array(covariance))
    if not valid:
        raise Invalid
    with np.errstate(under="ignore"):
        return Belief(np.zeros(3), root @ root.T)


def _sigmas(belief: Belief) -> Any:
    return np.sqrt(np.diagonal(belief.covariance))


def _correlations(belief: Belief) -> Any:
    sigma = np.where(_sigmas(belief) > 0.0, _sigmas(belief), 1.0)
    with np.errstate(under="ignore"):
        return (belief.covariance / sigma / sigma[:, None])[[0, 0, 1], [1, 2, 2]]


SUBJECTS: dict[str, Subject] = {
    "updated_pose": lambda **inputs: _run_update(**inputs).mean,
    "updated_sigmas": lambda **inputs: _sigmas(_run_update(**inputs)),
    "updated_correlations": lambda **inputs: _correlations(_run_update(**inputs)),
    "predicted_sigmas": lambda **inputs: _sigmas(_run_prediction(**inputs)),
    "predicted_correlations": lambda **inputs: _correlations(_run_prediction(**inputs)),
    "root_sigmas": lambda covariance: _sigmas(_square_root(covariance)),
    "root_correlations": lambda covariance: _correlations(_square_root(covariance)),
    "refused": _run_update,
    "predicted": _run_prediction,
    "belief": lambda mean, covariance: Belief(np.array(mean), np.array(covariance)),
}
