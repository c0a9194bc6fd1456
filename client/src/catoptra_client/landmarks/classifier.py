"""The pixel classifiers: is a colour a landmark's? Schmits & Visser 2009, Eq. 3.

A colour rgb is labelled cyan, magenta or yellow if P(rgb|colour) / P(rgb|neg) >= theta. With counts
n and totals N that is n_pos N_neg >= theta n_neg N_pos, compared in Python's integers: exact,
without a division by zero. Departures, where Eq. 3 is silent: a colour never seen as a landmark is
none, whatever theta; one seen on a landmark and never elsewhere passes any theta; where several
classifiers accept, the largest ratio wins, and of equal ones the first in `BAND_COLOURS`. All decisions
are compiled into one table, so that labelling is a look-up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from catoptra_client.landmarks.histogram import Counts, Histogram, UInt8Array, bin_index
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import BAND_COLOURS

NO_COLOUR = 0
COLOUR_CODES = {colour: code for code, colour in enumerate(BAND_COLOURS, start=1)}

# A landmark's colours fill about 1/100 of a frame: at 10 a shade must be ten times as likely on the
# landmark as elsewhere. Missing a mixed border pixel costs nothing, a wrong blob an identity.
DEFAULT_THETA = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class ColourClassifier:
    """Three classifiers against the rest, and the table that they compile to.

    positives: a histogram for each of `BAND_COLOURS`. theta: the threshold of Eq. 3, >= 0, inf allowed.
    table (bins^3,) uint8: code of each colour bin, 0 for none.
    """

    positives: Mapping[str, Histogram]
    negative: Histogram
    theta: float
    lookup_table: UInt8Array

    @property
    def bins(self) -> int:
        """Return the number of bins per channel."""
        return self.negative.bins


def classifier_from_histograms(
    positives: Mapping[str, Histogram], negative: Histogram, *, theta: float = DEFAULT_THETA
) -> ColourClassifier:
    """Return the classifier of trained histograms. Raises DomainError for an empty class."""
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
    compiled = table.astype(np.uint8).ravel()
    compiled.setflags(write=False)
    return ColourClassifier(dict(positives), negative, theta, compiled)


def likelihood_ratio_test(
    positive: Histogram, negative: Histogram, *, theta: float
) -> npt.NDArray[np.bool_]:
    """Return (bins, bins, bins): the colours that Eq. 3 calls a landmark's.

    Raises DomainError for a class that has seen nothing, whose likelihoods would be 0 / 0, for
    different bins, and for a theta that is no ratio.
    """
    _check_histograms({"pos": positive, "neg": negative}, theta)
    seen = positive.counts > 0
    if math.isinf(theta):
        return np.asarray(seen & (negative.counts == 0), dtype=np.bool_)
    ratio = Fraction(theta)  # exact: a float is a fraction
    left = _to_python_ints(positive.counts) * (negative.total * ratio.denominator)
    right = _to_python_ints(negative.counts) * (positive.total * ratio.numerator)
    return np.asarray(seen & (left >= right), dtype=np.bool_)


def label_image(classifier: ColourClassifier, image: UInt8Array) -> UInt8Array:
    """Return the (...) colour codes of (..., 3) RGB uint8 pixels: one look-up each.

    0.7 ms for 720 x 180 pixels. Measured in tests/measurements/detection_time.py.
    """
    labels: UInt8Array = classifier.lookup_table[bin_index(image, classifier.bins)]
    return labels


def _max_likelihood_index(
    positives: Mapping[str, Histogram], is_candidate: npt.NDArray[np.bool_]
) -> Counts:
    """Return the index in `BAND_COLOURS` of the largest likelihood among the accepted ones.

    All ratios share the denominator P(rgb|neg), so n / N decides, on the common denominator of the
    three totals. argmax takes the first of equal ones.
    """
    common = math.prod(positives[colour].total for colour in BAND_COLOURS)
    likelihood = np.stack(
        [
            _to_python_ints(positives[c].counts) * (common // positives[c].total)
            for c in BAND_COLOURS
        ]
    )
    best: Counts = np.where(is_candidate, likelihood, -1).argmax(axis=0)
    return best


def _to_python_ints(counts: Counts) -> npt.NDArray[np.object_]:
    """Return counts as Python integers, whose products do not overflow."""
    return counts.astype(np.object_)


def _check_histograms(classes: Mapping[str, Histogram], theta: float) -> None:
    if not theta >= 0.0:
        raise DomainError(f"theta is a ratio of likelihoods, >= 0: {theta!r}")
    empty = [name for name, histogram in classes.items() if histogram.total == 0]
    if empty:
        raise DomainError(f"no pixel was seen of: {', '.join(empty)}; train on more frames")
    if len({histogram.bins for histogram in classes.values()}) != 1:
        raise DomainError("the histograms have different numbers of bins")
