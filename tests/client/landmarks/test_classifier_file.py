"""Classifier files: round trip, and errors that name the invalid entry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_client.landmarks import load_classifier, save_classifier
from catoptra_client.landmarks.classifier import Histogram, classifier_from_histograms
from catoptra_protocol.errors import ConfigError


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


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04broken", b"\x93NUMPY"])
def test_file_that_is_no_npz_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "colours.npz"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="readable"):
        load_classifier(path)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.npz"):
        load_classifier(tmp_path / "none.npz")


def test_pickled_entry_is_not_opened(small_classifier, tmp_path: Path) -> None:
    path = tmp_path / "colours.npz"
    save_classifier(small_classifier, path)
    rewrite_entries(path, cyan=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ConfigError, match="pickle"):
        load_classifier(path)


def test_truncated_file_is_named(small_classifier, tmp_path: Path) -> None:
    path = tmp_path / "colours.npz"
    save_classifier(small_classifier, path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ConfigError, match="readable"):
        load_classifier(path)
