"""Hard cases of histograms: empty, full, and one pixel too many."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_client.landmarks import classifier
from catoptra_client.landmarks.classifier import Histogram
from stability.catalogue import Subject


def _of(counts: list[Any]) -> Histogram:
    """Histogram with these counts in the first bins."""
    return Histogram(np.array([*counts, *[0] * (8 - len(counts))]).reshape(2, 2, 2))


SUBJECTS: dict[str, Subject] = {
    "total": lambda counts: _of(counts).total,
    "merged": lambda first, second: classifier.merge_histograms(
        _of(first), _of(second)
    ).counts.ravel()[:3],
    "spread_total": lambda counts: classifier.smooth_histogram(_of(counts)).total,
}
