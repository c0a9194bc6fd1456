"""Hard cases of gate, interval and NEES: tiny tails, few and many dof, singular beliefs."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_client.localization import Belief, ekf, filter_health
from stability.catalogue import Invalid, Subject


def _nees(mean: Any, covariance: Any, truth: Any) -> float:
    belief = Belief(np.array(mean), np.array(covariance))
    value, defined = filter_health.nees(belief, np.array(truth))
    if not defined:
        raise Invalid
    return value


SUBJECTS: dict[str, Subject] = {
    "threshold": lambda dof, false_rejection_rate: ekf.ValidationGate(
        false_rejection_rate
    ).threshold(dof),
    "interval": lambda dof, num_runs, confidence: filter_health.chi_square_mean_interval(
        dof, num_runs, confidence=confidence
    ),
    "nees": _nees,
}
