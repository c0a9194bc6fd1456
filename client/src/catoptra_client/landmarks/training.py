"""Training: from labelled frames to histograms, and from histograms to a classifier."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from catoptra_client.landmarks.classifier import (
    COLOUR_CODES,
    DEFAULT_THETA,
    NO_COLOUR,
    ColourClassifier,
    classifier_from_histograms,
)
from catoptra_client.landmarks.histogram import (
    DEFAULT_BINS,
    Histogram,
    UInt8Array,
    empty_histogram,
    histogram_from_pixels,
    merge_histograms,
    smooth_histogram,
)
from catoptra_protocol.errors import DomainError


@dataclass(frozen=True, slots=True, eq=False)
class TrainingHistograms:
    """Pixel counts of the labelled frames so far."""

    positives: dict[str, Histogram]
    """Histogram of each landmark colour."""
    negative: Histogram
    """Histogram of all other pixels."""


def empty_training_histograms(bins: int = DEFAULT_BINS) -> TrainingHistograms:
    """Histograms before the first frame."""
    return TrainingHistograms(
        {colour: empty_histogram(bins) for colour in COLOUR_CODES}, empty_histogram(bins)
    )


def add_labelled_frame(
    histograms: TrainingHistograms, frame: UInt8Array, *, labels: UInt8Array
) -> TrainingHistograms:
    """Histograms with one more frame: (h, w, 3) RGB and its (h, w) labels.

    Raises:
        DomainError: frame and labels differ in size.
    """
    if frame.shape != (*labels.shape, 3):
        raise DomainError(f"labels {labels.shape} do not belong to a frame {frame.shape}")
    bins = histograms.negative.bins

    def accumulate(histogram: Histogram, code: int) -> Histogram:
        return merge_histograms(histogram, histogram_from_pixels(frame[labels == code], bins))

    positives = {c: accumulate(histograms.positives[c], code) for c, code in COLOUR_CODES.items()}
    return TrainingHistograms(positives, accumulate(histograms.negative, NO_COLOUR))


def train(
    labelled_frames: Iterable[tuple[UInt8Array, UInt8Array]],
    *,
    theta: float = DEFAULT_THETA,
    bins: int = DEFAULT_BINS,
) -> ColourClassifier:
    """Train a classifier on (frame, labels) pairs, in any order.

    Args:
        labelled_frames: (h, w, 3) RGB frames with their (h, w) labels.
        theta: threshold of Eq. 3.
        bins: bins per channel.
    """
    histograms = empty_training_histograms(bins)
    for frame, labels in labelled_frames:
        histograms = add_labelled_frame(histograms, frame, labels=labels)
    # Smoothed, because some twenty frames do not show every shade of a cylinder under its lights.
    positives = {
        colour: smooth_histogram(histogram) for colour, histogram in histograms.positives.items()
    }
    return classifier_from_histograms(positives, smooth_histogram(histograms.negative), theta=theta)
