"""Hard cases of Eq. 3: ties, unseen colours, empty classes, thresholds of zero and infinity."""

from __future__ import annotations

import numpy as np

from catoptra_client.landmarks import classifier
from catoptra_client.landmarks.classifier import Histogram
from stability.catalogue import Subject


def _classify(n_pos: int, all_pos: int, n_neg: int, all_neg: int, theta: float) -> bool:
    """Decision on the first bin; the rest of both classes lies in separate bins."""
    positive, negative = np.zeros((2, 8), dtype=np.int64)
    positive[:2] = n_pos, all_pos - n_pos
    negative[[0, 2]] = n_neg, all_neg - n_neg
    histograms = (Histogram(counts.reshape(2, 2, 2)) for counts in (positive, negative))
    return bool(classifier.likelihood_ratio_test(*histograms, theta=theta)[0, 0, 0])


SUBJECTS: dict[str, Subject] = {"accepted": _classify}
