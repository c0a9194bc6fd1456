"""Histograms, the classifier that they make, and its file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.landmarks import load_classifier, save_classifier
from catoptra_client.landmarks.classifier import (
    COLOUR_CODES,
    Histogram,
    classifier_from_histograms,
    colour_index,
    empty_histogram,
    histogram_from_pixels,
    label_image,
    likelihood_ratio_test,
    merge_histograms,
    smooth_histogram,
)
from catoptra_protocol.errors import ConfigError, DomainError


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


def classify_contested_bin(cyan: Histogram, magenta: Histogram) -> int:
    """Code of bin 0 when both cyan and magenta accept the bin."""
    positives = {"cyan": cyan, "magenta": magenta, "yellow": make_histogram((7, 1))}
    return int(
        classifier_from_histograms(positives, make_histogram((6, 1)), theta=1.0).lookup_table[0]
    )


@pytest.mark.parametrize(
    ("cyan", "magenta", "winner"),
    [
        # The larger ratio, not the larger count; of equal ratios the first colour.
        (((0, 50), (1, 950)), ((0, 10), (1, 10)), MAGENTA),
        (((0, 10), (1, 30)), ((0, 1), (1, 3)), CYAN),
    ],
)
def test_contested_bin_goes_to_the_larger_likelihood_ratio(cyan, magenta, winner: int) -> None:
    assert classify_contested_bin(make_histogram(*cyan), make_histogram(*magenta)) == winner


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


@pytest.fixture
def small_classifier():
    rng = np.random.default_rng(1)
    histograms = [Histogram(rng.integers(0, 50, (8, 8, 8))) for _ in range(4)]
    positives = dict(zip(("cyan", "magenta", "yellow"), histograms[:3], strict=True))
    return classifier_from_histograms(positives, histograms[3], theta=1.3)


def rewrite_entries(path: Path, **changes) -> None:
    with np.load(path) as stored:
        entries = {**stored, **changes}
    with path.open("wb") as file:
        np.savez(file, **{name: entry for name, entry in entries.items() if entry is not None})


def test_saved_classifier_equals_the_loaded_one(small_classifier, tmp_path: Path) -> None:
    path = tmp_path / "colours.classifier"
    save_classifier(small_classifier, path)
    again = load_classifier(path)
    np.testing.assert_array_equal(again.lookup_table, small_classifier.lookup_table)
    assert again.theta == small_classifier.theta


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"neg": None}, "neg"),
        ({"schema": np.array("other")}, "catoptra-colour-classifier"),
        ({"version": np.array(2)}, "train it anew"),
        ({"theta": np.array(-1.0)}, "theta"),
        ({"cyan": np.zeros((8, 8, 8), int)}, "no training pixel of: cyan"),
        ({"cyan": np.zeros((4, 4, 4), int)}, "cyan"),
        ({"cyan": np.ones(7)}, "cube"),
        ({"theta": np.array([1.0, 2.0])}, "readable"),
    ],
)
def test_broken_entry_is_named(small_classifier, tmp_path: Path, changes, message) -> None:
    path = tmp_path / "colours.npz"
    save_classifier(small_classifier, path)
    rewrite_entries(path, **changes)
    with pytest.raises(ConfigError, match=message) as caught:
        load_classifier(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        *((content, "readable") for content in (b"", b"not a zip", b"PK\x03\x04no", b"\x93NUMPY")),
        (None, r"colours\.npz"),
    ],
)
def test_file_that_is_no_npz_is_named(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "colours.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        load_classifier(path)


def test_pickled_entry_is_not_opened_nor_a_truncated_file(small_classifier, tmp_path: Path) -> None:
    path = tmp_path / "colours.npz"
    save_classifier(small_classifier, path)
    whole = path.read_bytes()
    rewrite_entries(path, cyan=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ConfigError, match="pickle"):
        load_classifier(path)
    path.write_bytes(whole[:-200])
    with pytest.raises(ConfigError, match="readable"):
        load_classifier(path)
