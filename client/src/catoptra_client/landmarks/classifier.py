"""Pixel classifiers: likelihood-ratio tests of a colour. Schmits & Visser 2009, Eq. 3.

A colour rgb is labelled cyan, magenta or yellow if P(rgb|colour) / P(rgb|neg) >= theta. With counts
n and totals N that is n_pos N_neg >= theta n_neg N_pos, evaluated in Python's integers: exact,
without a division by zero. All decisions are compiled into one table, so that labelling is a
look-up.

Eq. 3 leaves three cases open. A colour never observed on a landmark is rejected for any theta; a
colour observed on a landmark and never elsewhere is accepted for any theta; where several
classifiers accept, the largest ratio wins, and of equal ratios the first in `BAND_COLOURS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from catoptra_client.landmarks.histogram import (
    MAX_BINS,
    Counts,
    Histogram,
    UInt8Array,
    colour_index,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import BAND_COLOURS

NO_COLOUR = 0
COLOUR_CODES = {colour: code for code, colour in enumerate(BAND_COLOURS, start=1)}

# Landmark colours fill about 1/100 of a frame; at 10 a shade must be ten times as likely on the
# landmark as elsewhere. A missed border pixel costs little, a false blob a wrong landmark.
DEFAULT_THETA = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class ColourClassifier:
    """Three classifiers against the rest, and the table compiled from the histograms."""

    positives: Mapping[str, Histogram]
    """Histogram of each colour in `BAND_COLOURS`."""
    negative: Histogram
    """Histogram of all other pixels."""
    theta: float
    """Threshold of Eq. 3, >= 0; may be inf."""
    lookup_table: UInt8Array
    """Code of each of 32^3 colours, (32768,) uint8; `NO_COLOUR` for none."""

    @property
    def bins(self) -> int:
        """Number of bins per channel."""
        return self.negative.bins


def classifier_from_histograms(
    positives: Mapping[str, Histogram], negative: Histogram, *, theta: float = DEFAULT_THETA
) -> ColourClassifier:
    """Compile trained histograms into a classifier.

    Args:
        positives: a histogram for each colour in `BAND_COLOURS`.
        negative: histogram of the other pixels.
        theta: threshold of Eq. 3.

    Raises:
        DomainError: a colour is missing, a histogram is empty, bins differ, or theta is negative.
    """
    if set(positives) != set(BAND_COLOURS):
        raise DomainError(
            f"the classifier needs {', '.join(BAND_COLOURS)}, not {sorted(positives)}"
        )
    _check_histograms({**positives, "neg": negative}, theta)
    accepted = np.stack(
        [likelihood_ratio_test(positives[c], negative, theta=theta) for c in BAND_COLOURS]
    )
    table = np.where(
        accepted.any(axis=0), 1 + _max_likelihood_index(positives, accepted), NO_COLOUR
    )
    # uint8 keeps the table of 32^3 bins at 32 KB, the size of a first-level cache. A wider bin
    # fills several of its entries.
    width = np.ones((MAX_BINS // negative.bins,) * 3, dtype=np.uint8)
    compiled = np.kron(table.astype(np.uint8), width).ravel()
    compiled.setflags(write=False)
    return ColourClassifier(dict(positives), negative, theta, compiled)


def likelihood_ratio_test(
    positive: Histogram, negative: Histogram, *, theta: float
) -> npt.NDArray[np.bool_]:
    """Colours that Eq. 3 accepts, as a (bins, bins, bins) mask.

    Raises:
        DomainError: a histogram is empty (its likelihoods would be 0 / 0), bins differ, or theta is
            no ratio.
    """
    _check_histograms({"pos": positive, "neg": negative}, theta)
    observed = positive.counts > 0
    # inf has no ratio of integers: only colours without negative counts remain.
    if math.isinf(theta):
        return np.asarray(observed & (negative.counts == 0), dtype=np.bool_)
    ratio = Fraction(theta)  # exact: every finite float is a fraction
    left = _to_python_ints(positive.counts) * (negative.total * ratio.denominator)
    right = _to_python_ints(negative.counts) * (positive.total * ratio.numerator)
    return np.asarray(observed & (left >= right), dtype=np.bool_)


def label_image(classifier: ColourClassifier, image: UInt8Array) -> UInt8Array:
    """Colour codes (...) of (..., 3) RGB uint8 pixels, by one look-up each.

    0.1 ms for 720 x 180 pixels. Measured in tests/measurements/detection_time.py.
    """
    # take: twice as fast as an index in brackets, for which the numbers are converted first.
    labels: UInt8Array = classifier.lookup_table.take(colour_index(image))
    return labels


def _max_likelihood_index(
    positives: Mapping[str, Histogram], is_candidate: npt.NDArray[np.bool_]
) -> Counts:
    """Index in `BAND_COLOURS` of the largest likelihood among the accepting classifiers."""
    # All ratios share the denominator P(rgb|neg), so n / N decides: compared on the common
    # denominator of the three totals, in integers. argmax takes the first of equal ones.
    common_total = math.prod(positives[colour].total for colour in BAND_COLOURS)
    likelihood = np.stack(
        [
            _to_python_ints(positives[c].counts) * (common_total // positives[c].total)
            for c in BAND_COLOURS
        ]
    )
    best: Counts = np.where(is_candidate, likelihood, -1).argmax(axis=0)
    return best


def _to_python_ints(counts: Counts) -> npt.NDArray[np.object_]:
    """Convert counts to Python integers, whose products cannot overflow."""
    return counts.astype(np.object_)


def _check_histograms(classes: Mapping[str, Histogram], theta: float) -> None:
    if not theta >= 0.0:
        raise DomainError(f"theta is a ratio of likelihoods, >= 0: {theta!r}")
    empty = [name for name, histogram in classes.items() if histogram.total == 0]
    if empty:
        raise DomainError(f"no training pixel of: {', '.join(empty)}; train on more frames")
    if len({histogram.bins for histogram in classes.values()}) != 1:
        raise DomainError("the histograms have different numbers of bins")
