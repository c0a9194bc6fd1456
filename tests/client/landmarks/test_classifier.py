"""Eq. 3: ties at the threshold, and every case that the equation leaves open."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.landmarks.classifier import (
    COLOUR_CODES,
    Histogram,
    classifier_from_histograms,
    empty_histogram,
    histogram_from_pixels,
    label_image,
    likelihood_ratio_test,
)
from catoptra_protocol.errors import DomainError

CYAN, MAGENTA, YELLOW = COLOUR_CODES["cyan"], COLOUR_CODES["magenta"], COLOUR_CODES["yellow"]
SHADES = {"cyan": (0, 200, 200), "magenta": (200, 0, 200), "yellow": (200, 200, 0)}
GREY = (100, 100, 100)


def make_histogram(*entries: tuple[int, int], bins: int = 2) -> Histogram:
    """Histogram with (flat bin, count) entries."""
    table = np.zeros(bins**3, dtype=np.int64)
    for index, count in entries:
        table[index] = count
    return Histogram(table.reshape(bins, bins, bins))


def single_colour_histogram(rgb, bins: int = 32) -> Histogram:
    return histogram_from_pixels(np.array([rgb], dtype=np.uint8), bins)


def make_classifier(bins: int = 32):
    positives = {colour: single_colour_histogram(rgb, bins) for colour, rgb in SHADES.items()}
    return classifier_from_histograms(positives, single_colour_histogram(GREY, bins))


@pytest.mark.parametrize(
    ("n_pos", "accepted"),
    [(30, True), (29, False), (31, True)],
)
def test_threshold_itself_passes_and_one_count_less_does_not(n_pos, accepted) -> None:
    # Totals 100 each, 10 of the rest: 30 : 10 is theta = 3 exactly.
    positive, negative = (
        make_histogram((0, n_pos), (1, 100 - n_pos)),
        make_histogram((0, 10), (2, 90)),
    )
    assert likelihood_ratio_test(positive, negative, theta=3.0)[0, 0, 0] == accepted


def test_threshold_with_no_binary_fraction_is_taken_as_the_float_it_is() -> None:
    # 0.1 as a float is a little more than 1/10, so a ratio of exactly 1/10 must fail.
    positive, negative = make_histogram((0, 1), (1, 99)), make_histogram((0, 10), (2, 90))
    assert not likelihood_ratio_test(positive, negative, theta=0.1)[0, 0, 0]
    assert likelihood_ratio_test(positive, negative, theta=math.nextafter(0.1, 0.0))[0, 0, 0]


def test_counts_beyond_64_bit_products_are_compared_exactly() -> None:
    huge = 2**62
    positive, negative = make_histogram((0, huge)), make_histogram((0, huge - 1), (1, 1))
    assert likelihood_ratio_test(positive, negative, theta=1.0)[0, 0, 0]
    assert not likelihood_ratio_test(
        make_histogram((0, huge - 1), (1, 1)), make_histogram((0, huge)), theta=1.0
    )[0, 0, 0]


@pytest.mark.parametrize("theta", [0.0, 1.0, math.inf])
def test_unseen_colour_is_no_landmark_whatever_the_threshold(theta: float) -> None:
    accepted = likelihood_ratio_test(make_histogram((0, 5)), make_histogram((1, 5)), theta=theta)
    assert accepted[0, 0, 0]  # only ever on the landmark: passes any theta
    assert not accepted[1, 1, 1]  # never seen
    assert not accepted[0, 0, 1]  # seen elsewhere only


def test_infinite_threshold_wants_a_colour_of_its_own() -> None:
    accepted = likelihood_ratio_test(
        make_histogram((0, 500), (1, 5)), make_histogram((0, 1)), theta=math.inf
    )
    assert not accepted[0, 0, 0]
    assert accepted[0, 0, 1]


def test_zero_threshold_takes_every_colour_ever_seen_on_a_landmark() -> None:
    assert likelihood_ratio_test(
        make_histogram((0, 1), (1, 9)), make_histogram((0, 10**9)), theta=0.0
    )[0, 0, 0]


def classify_contested_bin(cyan: Histogram, magenta: Histogram) -> int:
    """Code of bin 0 when both cyan and magenta accept the bin."""
    positives = {"cyan": cyan, "magenta": magenta, "yellow": make_histogram((7, 1))}
    return int(
        classifier_from_histograms(positives, make_histogram((6, 1)), theta=1.0).lookup_table[0]
    )


def test_larger_likelihood_ratio_wins_not_the_larger_count() -> None:
    assert (
        classify_contested_bin(make_histogram((0, 50), (1, 950)), make_histogram((0, 10), (1, 10)))
        == MAGENTA
    )


def test_equal_ratios_go_to_the_first_colour() -> None:
    assert (
        classify_contested_bin(make_histogram((0, 10), (1, 30)), make_histogram((0, 1), (1, 3)))
        == CYAN
    )


@pytest.mark.parametrize("empty", ["cyan", "neg"])
def test_empty_class_is_rejected_by_name(empty: str) -> None:
    classes = {colour: single_colour_histogram(rgb) for colour, rgb in SHADES.items()} | {
        "neg": single_colour_histogram(GREY)
    }
    classes[empty] = empty_histogram()
    negative = classes.pop("neg")
    with pytest.raises(DomainError, match=f"no training pixel of: {empty}"):
        classifier_from_histograms(classes, negative)


@pytest.mark.parametrize("theta", [-1.0, math.nan])
def test_threshold_that_is_no_ratio_is_rejected(theta: float) -> None:
    positives = {colour: single_colour_histogram(rgb) for colour, rgb in SHADES.items()}
    with pytest.raises(DomainError, match="theta"):
        classifier_from_histograms(positives, single_colour_histogram(GREY), theta=theta)


def test_missing_colour_and_other_bins_are_rejected() -> None:
    positives = {colour: single_colour_histogram(rgb) for colour, rgb in SHADES.items()}
    with pytest.raises(DomainError, match="different numbers"):
        classifier_from_histograms(positives, single_colour_histogram(GREY, 16))
    del positives["cyan"]
    with pytest.raises(DomainError, match="needs cyan"):
        classifier_from_histograms(positives, single_colour_histogram(GREY))


def test_each_colour_gets_its_code() -> None:
    image = np.array([[*SHADES.values(), GREY, (255, 255, 255)]], dtype=np.uint8)
    np.testing.assert_array_equal(
        label_image(make_classifier(), image), [[CYAN, MAGENTA, YELLOW, 0, 0]]
    )


@pytest.mark.parametrize("bins", [2, 16, 32])
def test_labels_equal_the_rule_pixel_by_pixel(bins: int) -> None:
    rng = np.random.default_rng(bins)
    filled = [Histogram(rng.integers(0, 9, (bins, bins, bins))) for _ in range(4)]
    positives = dict(zip(COLOUR_CODES, filled[:3], strict=True))
    classifier = classifier_from_histograms(positives, filled[3], theta=1.0)
    image = rng.integers(0, 256, (4, 5, 3), dtype=np.uint8)
    accepted = {c: likelihood_ratio_test(positives[c], filled[3], theta=1.0) for c in COLOUR_CODES}
    for place, label in np.ndenumerate(label_image(classifier, image)):
        r, g, b = (int(value) * bins // 256 for value in image[place])
        ratio = {c: positives[c].counts[r, g, b] / positives[c].total for c in COLOUR_CODES}
        passing = {c: ratio[c] for c in COLOUR_CODES if accepted[c][r, g, b]}
        best = max(passing, key=passing.__getitem__) if passing else None
        assert label == (COLOUR_CODES[best] if best else 0)


def test_image_that_is_not_rgb_bytes_is_rejected() -> None:
    with pytest.raises(DomainError, match="RGB pixels"):
        label_image(make_classifier(), np.zeros((4, 4), np.uint8))
