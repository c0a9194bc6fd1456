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
    Bytes,
    Histogram,
    empty_histogram,
    histogram_from_pixels,
    merged,
    spread,
)
from catoptra_protocol.errors import DomainError


@dataclass(frozen=True, slots=True, eq=False)
class TrainingHistograms:
    """What was counted so far: a histogram for each colour, and one for everything else."""

    positives: dict[str, Histogram]
    negative: Histogram


def no_training(bins: int = DEFAULT_BINS) -> TrainingHistograms:
    """Return the histograms before the first frame."""
    return TrainingHistograms(
        {colour: empty_histogram(bins) for colour in COLOUR_CODES}, empty_histogram(bins)
    )


def counted(so_far: TrainingHistograms, frame: Bytes, *, labels: Bytes) -> TrainingHistograms:
    """Return the histograms with one more frame: (h, w, 3) RGB and its (h, w) labels."""
    if frame.shape != (*labels.shape, 3):
        raise DomainError(f"labels {labels.shape} do not belong to a frame {frame.shape}")
    bins = so_far.negative.bins

    def more(histogram: Histogram, code: int) -> Histogram:
        return merged(histogram, histogram_from_pixels(frame[labels == code], bins))

    positives = {c: more(so_far.positives[c], code) for c, code in COLOUR_CODES.items()}
    return TrainingHistograms(positives, more(so_far.negative, NO_COLOUR))


def train(
    labelled_frames: Iterable[tuple[Bytes, Bytes]],
    *,
    theta: float = DEFAULT_THETA,
    bins: int = DEFAULT_BINS,
) -> ColourClassifier:
    """Return the classifier of (frame, labels) pairs.

    Counts are shared with the neighbouring bins (`spread`): some twenty frames do not show every
    shade of a cylinder under its lights.
    """
    histograms = no_training(bins)
    for frame, labels in labelled_frames:
        histograms = counted(histograms, frame, labels=labels)
    positives = {colour: spread(histogram) for colour, histogram in histograms.positives.items()}
    return classifier_from_histograms(positives, spread(histograms.negative), theta=theta)
