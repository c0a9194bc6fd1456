"""Pixel classifiers: likelihood-ratio tests of a colour, their histograms and files.

A colour rgb is labelled cyan, magenta or yellow if P(rgb|colour) / P(rgb|neg) >= theta. Histograms
are integer counts over RGB bins. With counts n and totals N the test is n_pos N_neg >= theta n_neg
N_pos, evaluated in Python's integers: exact, without a division by zero. All decisions are compiled
into one table, so that labelling is a look-up.

Eq. 3 leaves three cases open. A colour never observed on a landmark is rejected for any theta; a
colour observed on a landmark and never elsewhere is accepted for any theta; where several
classifiers accept, the largest ratio wins, and of equal ratios the first in `BAND_COLOURS`.

A file (.npz with a schema version, read without pickle) holds the histograms and theta. The table
is compiled on load, so that table and histograms cannot disagree. Source: Schmits & Visser 2009,
section 3.2 and Eq. 3.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, DomainError, SourceLocation
from catoptra_protocol.landmarks import BAND_COLOURS

UInt8Array = npt.NDArray[np.uint8]
_Counts = npt.NDArray[np.int64]

# 8 grey levels per bin: five times a camera's noise (1.4 levels at mid-grey), and a lookup table
# that fits the first-level cache. The paper does not state its number of bins. More than 32 have no
# place in `colour_index`.
DEFAULT_BINS = 32
_MAX_BINS = 32
_ALLOWED_BINS = (2, 4, 8, 16, _MAX_BINS)
# The sum of any two totals fits int64, so that the check of a merged total sees no wrap-around.
_MAX_TOTAL = 2**62
# Weight of a smoothed pixel: 1 + 2 + 1 along each of three axes.
_KERNEL_SUM = 64


@dataclass(frozen=True, slots=True, eq=False)
class Histogram:
    """Pixel counts by red, green and blue."""

    counts: _Counts
    """Counts (bins, bins, bins), read-only int64; `bins` is a power of two."""

    def __post_init__(self) -> None:
        counts = np.array(self.counts)
        if counts.ndim != 3 or len(set(counts.shape)) != 1:
            raise DomainError(f"a histogram is a cube of counts, not of shape {counts.shape}")
        _check_bins(counts.shape[0])
        if not np.issubdtype(counts.dtype, np.integer) or (counts < 0).any():
            raise DomainError("a histogram counts pixels: integers, not negative")
        _check_total(float(counts.sum(dtype=np.float64)))
        # A private copy, locked: the classifier's table is valid only while counts do not change.
        counts = counts.astype(np.int64)
        counts.setflags(write=False)
        object.__setattr__(self, "counts", counts)

    @property
    def bins(self) -> int:
        """Number of bins per channel."""
        return int(self.counts.shape[0])

    @property
    def total(self) -> int:
        """Number of pixels counted."""
        return int(self.counts.sum())


def empty_histogram(bins: int = DEFAULT_BINS) -> Histogram:
    """Histogram without pixels."""
    _check_bins(bins)
    return Histogram(np.zeros((bins, bins, bins), dtype=np.int64))


def histogram_from_pixels(pixels: UInt8Array, bins: int = DEFAULT_BINS) -> Histogram:
    """Histogram of (..., 3) RGB uint8 pixels."""
    _check_bins(bins)
    fine = np.bincount(colour_index(pixels).ravel(), minlength=_MAX_BINS**3)
    width = _MAX_BINS // bins  # fine bins that share one of the requested ones
    return Histogram(fine.reshape(bins, width, bins, width, bins, width).sum(axis=(1, 3, 5)))


def merge_histograms(first: Histogram, second: Histogram) -> Histogram:
    """Histogram of two sets of pixels together. Raises DomainError if the bins differ."""
    if first.bins != second.bins:
        raise DomainError(f"histograms of {first.bins} and {second.bins} bins do not add up")
    _check_total(first.total + second.total)
    return Histogram(first.counts + second.counts)


def smooth_histogram(histogram: Histogram) -> Histogram:
    """Distribute each pixel over the neighbouring bins with weights 1 : 2 : 1 along each axis.

    For training on few frames: a shade between two observed shades then has counts as well. Counts
    stay integers, 64 per pixel; weight beyond the border stays in the border bin.
    """
    _check_total(_KERNEL_SUM * histogram.total)
    counts = histogram.counts
    for axis in range(3):
        padded = np.pad(counts, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
        length = counts.shape[axis]
        below = padded.take(range(length), axis=axis)
        above = padded.take(range(2, length + 2), axis=axis)
        counts = below + 2 * counts + above
    return Histogram(counts)


def colour_index(pixels: UInt8Array) -> npt.NDArray[np.uint16]:
    """Indices (...) into a flattened cube of 32^3 colours of (..., 3) RGB uint8 pixels.

    The five high bits of red, green and blue side by side: OpenCV's 555 format. 0.02 ms for 720 x
    180 pixels, 0.25 with shifts in NumPy. Measured in tests/measurements/detection_time.py.
    """
    if pixels.dtype != np.uint8 or pixels.shape[-1:] != (3,):
        raise DomainError(f"RGB pixels are uint8 (..., 3), not {pixels.dtype} {pixels.shape}")
    if not pixels.size:  # OpenCV rejects empty images
        return np.zeros(pixels.shape[:-1], dtype=np.uint16)
    packed = cv2.cvtColor(pixels.reshape(1, -1, 3), cv2.COLOR_RGB2BGR555)
    return np.asarray(packed).view(np.uint16).reshape(pixels.shape[:-1])


def _check_total(total: float) -> None:
    if total > _MAX_TOTAL:
        raise DomainError(f"a histogram holds at most 2^62 pixels, not {total:.3g}")


def _check_bins(bins: int) -> None:
    if bins not in _ALLOWED_BINS:
        allowed = ", ".join(map(str, _ALLOWED_BINS))
        raise DomainError(f"bins per channel must be one of {allowed}, not {bins!r}")


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
    width = np.ones((_MAX_BINS // negative.bins,) * 3, dtype=np.uint8)
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

    0.06 ms for 360 x 360 pixels, half of the time of NumPy's `take`, which converts the numbers
    first. Measured in tests/measurements/detection_time.py.
    """
    index = colour_index(image)
    if not index.size:  # OpenCV rejects empty images
        return np.zeros(index.shape, dtype=np.uint8)
    # OpenCV's table is for all 16 bits of the index, of which the highest is 0.
    table = np.concatenate((classifier.lookup_table, classifier.lookup_table))
    return np.asarray(cv2.LUT(index.reshape(1, -1), table), dtype=np.uint8).reshape(index.shape)


def _max_likelihood_index(
    positives: Mapping[str, Histogram], is_candidate: npt.NDArray[np.bool_]
) -> _Counts:
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
    best: _Counts = np.where(is_candidate, likelihood, -1).argmax(axis=0)
    return best


def _to_python_ints(counts: _Counts) -> npt.NDArray[np.object_]:
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


_SCHEMA = "catoptra-colour-classifier"
_SCHEMA_VERSION = 1


def save_classifier(classifier: ColourClassifier, path: Path) -> None:
    """Write a classifier to exactly this path."""
    histograms = {colour: classifier.positives[colour].counts for colour in BAND_COLOURS}
    # An open file, because np.savez appends .npz to a path without that suffix.
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            schema=np.array(_SCHEMA),
            version=np.array(_SCHEMA_VERSION),
            theta=np.array(classifier.theta),
            neg=classifier.negative.counts,
            **histograms,  # type: ignore[arg-type] # savez declares its flag allow_pickle among the arrays
        )


def load_classifier(path: Path) -> ColourClassifier:
    """Read a classifier.

    Raises:
        ConfigError: the file is missing, unreadable or invalid; the message names path and entry.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return _parse_classifier({name: stored[name] for name in stored.files}, path)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, TypeError) as error:
        raise _config_error(path, "file", str(path), f"a readable .npz ({error})") from error


def _parse_classifier(entries: dict[str, np.ndarray], path: Path) -> ColourClassifier:
    missing = {"schema", "version", "theta", "neg", *BAND_COLOURS} - set(entries)
    if missing:
        raise _config_error(path, "entries", ", ".join(sorted(entries)), f"also {sorted(missing)}")
    if str(entries["schema"]) != _SCHEMA:
        raise _config_error(path, "schema", str(entries["schema"]), _SCHEMA)
    if str(entries["version"]) != str(_SCHEMA_VERSION):
        expected = f"{_SCHEMA_VERSION}; train it anew with this version of Catoptra"
        raise _config_error(path, "version", str(entries["version"]), expected)
    try:
        positives = {colour: Histogram(entries[colour]) for colour in BAND_COLOURS}
        negative, theta = Histogram(entries["neg"]), float(entries["theta"])
        return classifier_from_histograms(positives, negative, theta=theta)
    except DomainError as error:
        raise _config_error(path, "histograms", "unusable", str(error)) from error


def _config_error(path: Path, key: str, value: str, expected: str) -> ConfigError:
    return ConfigError(SourceLocation(str(path)), key=key, value=value, expected=expected)
