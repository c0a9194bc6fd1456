"""Histograms: exact counts in the right bins."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_client.landmarks.classifier import (
    Histogram,
    colour_index,
    empty_histogram,
    histogram_from_pixels,
    merge_histograms,
    smooth_histogram,
)
from catoptra_protocol.errors import DomainError


def make_pixels(*rgb: tuple[int, int, int]) -> np.ndarray:
    return np.array(rgb, dtype=np.uint8)


def test_pixels_fall_into_their_bins() -> None:
    counts = histogram_from_pixels(make_pixels((0, 8, 255), (7, 15, 248), (8, 8, 255)), 32).counts
    assert counts[0, 1, 31] == 2
    assert counts[1, 1, 31] == 1
    assert counts.sum() == 3


@pytest.mark.parametrize("bins", [2, 4, 8, 16, 32])
def test_every_byte_has_a_bin(bins: int) -> None:
    grey = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    counts = histogram_from_pixels(grey, bins).counts
    assert [counts[i, i, i] for i in range(bins)] == [256 // bins] * bins
    assert counts.sum() == 256


def test_colour_index_is_the_number_of_five_bits_per_channel() -> None:
    rgb = np.random.default_rng(5).integers(0, 256, (7, 5, 3), dtype=np.uint8)
    red, green, blue = np.moveaxis(rgb.astype(int) >> 3, -1, 0)
    np.testing.assert_array_equal(colour_index(rgb), (red * 32 + green) * 32 + blue)
    # Also where the rows of an image are a part of wider ones.
    np.testing.assert_array_equal(colour_index(rgb[:, 1:3]), colour_index(rgb)[:, 1:3])


def test_no_pixels_count_nothing() -> None:
    assert histogram_from_pixels(np.zeros((0, 3), np.uint8)).total == 0


def test_merging_adds_and_does_not_depend_on_order() -> None:
    a, b = (
        histogram_from_pixels(make_pixels((1, 2, 3))),
        histogram_from_pixels(make_pixels((200, 2, 3))),
    )
    np.testing.assert_array_equal(merge_histograms(a, b).counts, merge_histograms(b, a).counts)
    assert merge_histograms(a, b).total == 2


def test_merging_other_bins_is_rejected() -> None:
    with pytest.raises(DomainError, match="32 and 16"):
        merge_histograms(empty_histogram(32), empty_histogram(16))


@pytest.mark.parametrize("rgb", [(100, 100, 100), (0, 0, 0), (255, 0, 128)])
def test_smoothing_keeps_64_per_pixel_around_its_bin(rgb) -> None:
    before = histogram_from_pixels(make_pixels(rgb))
    after = smooth_histogram(before)
    assert after.total == 64
    assert after.counts[np.nonzero(before.counts)][0] == after.counts.max()


def test_counts_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        empty_histogram().counts[0, 0, 0] = 1


@pytest.mark.parametrize(
    "counts",
    [np.zeros((4, 4)), np.zeros((4, 4, 8), int), np.zeros((4, 4, 4)), -np.ones((4, 4, 4), int)],
)
def test_invalid_counts_are_rejected(counts) -> None:
    with pytest.raises(DomainError):
        Histogram(counts)


@pytest.mark.parametrize("bins", [0, 1, 3, 33, 64, 128])
def test_bins_that_do_not_divide_a_byte_are_rejected(bins: int) -> None:
    with pytest.raises(DomainError, match="bins per channel"):
        empty_histogram(bins)


@pytest.mark.parametrize("bad", [np.zeros((5, 3)), np.zeros((5, 4), np.uint8)])
def test_pixels_that_are_not_rgb_bytes_are_rejected(bad) -> None:
    with pytest.raises(DomainError, match="RGB pixels"):
        histogram_from_pixels(bad)


def test_unsigned_count_that_would_turn_negative_is_rejected() -> None:
    counts = np.zeros((2, 2, 2), dtype=np.uint64)
    counts[0, 0, 0] = 2**63 + 5
    with pytest.raises(DomainError, match="at most"):
        Histogram(counts)
