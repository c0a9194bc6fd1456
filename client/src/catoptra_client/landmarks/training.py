"""Training: from labelled frames to histograms to a classifier. Pure functions, any order."""

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
    """What was counted so far: a histogram for each colour, and one for everything else."""

    positives: dict[str, Histogram]
    negative: Histogram


def empty_training_histograms(bins: int = DEFAULT_BINS) -> TrainingHistograms:
    """Return the histograms before the first frame."""
    return TrainingHistograms(
        {colour: empty_histogram(bins) for colour in COLOUR_CODES}, empty_histogram(bins)
    )


def add_labelled_frame(
    histograms: TrainingHistograms, frame: UInt8Array, *, labels: UInt8Array
) -> TrainingHistograms:
    """Return the histograms with one more frame: (h, w, 3) RGB and its (h, w) labels."""
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
    """Return the classifier of (frame, labels) pairs.

    Counts are shared with the neighbouring bins (`spread`): some twenty frames do not show every
    shade of a cylinder under its lights.
    """
    histograms = empty_training_histograms(bins)
    for frame, labels in labelled_frames:
        histograms = add_labelled_frame(histograms, frame, labels=labels)
    positives = {
        colour: smooth_histogram(histogram) for colour, histogram in histograms.positives.items()
    }
    return classifier_from_histograms(positives, smooth_histogram(histograms.negative), theta=theta)
