"""Training: counts of labelled pixels."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_client.landmarks import (
    COLOUR_CODES,
    IGNORE_LABEL,
    add_labelled_frame,
    empty_training_histograms,
    train,
)
from catoptra_client.landmarks.classifier import histogram_from_pixels
from catoptra_protocol.errors import DomainError

FRAME = np.random.default_rng(3).integers(0, 256, (6, 7, 3), dtype=np.uint8)
LABELS = np.array([[0, 1, 2, 3, IGNORE_LABEL, 0, 1]] * 6, dtype=np.uint8)


def test_each_label_counts_into_its_own_histogram() -> None:
    histograms = add_labelled_frame(empty_training_histograms(), FRAME, labels=LABELS)
    assert [histograms.positives[c].total for c in COLOUR_CODES] == [12, 6, 6]
    assert histograms.negative.total == 12
    expected = histogram_from_pixels(FRAME[:, 2])
    np.testing.assert_array_equal(histograms.positives["magenta"].counts, expected.counts)


def test_order_of_frames_does_not_matter() -> None:
    other = FRAME[::-1].copy(), LABELS[:, ::-1].copy()
    one = train([(FRAME, LABELS), other])
    two = train([other, (FRAME, LABELS)])
    np.testing.assert_array_equal(one.lookup_table, two.lookup_table)


def test_labels_of_another_frame_are_rejected() -> None:
    with pytest.raises(DomainError, match="do not belong"):
        add_labelled_frame(empty_training_histograms(), FRAME, labels=LABELS[:3])


def test_training_on_nothing_is_rejected() -> None:
    with pytest.raises(DomainError, match="train on more frames"):
        train([])
