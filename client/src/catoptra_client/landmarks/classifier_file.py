"""Classifier files: .npz with a schema version, read without pickle.

A file holds the histograms and theta. The table is compiled on load, so that table and histograms
cannot disagree.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from catoptra_client.landmarks.classifier import ColourClassifier, classifier_from_histograms
from catoptra_client.landmarks.histogram import Histogram
from catoptra_protocol.errors import ConfigError, DomainError, SourceLocation
from catoptra_protocol.landmarks import BAND_COLOURS

SCHEMA = "catoptra-colour-classifier"
SCHEMA_VERSION = 1


def save_classifier(classifier: ColourClassifier, path: Path) -> None:
    """Write a classifier to exactly this path."""
    histograms = {colour: classifier.positives[colour].counts for colour in BAND_COLOURS}
    # An open file, because np.savez appends .npz to a path without that suffix.
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            schema=np.array(SCHEMA),
            version=np.array(SCHEMA_VERSION),
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
    if str(entries["schema"]) != SCHEMA:
        raise _config_error(path, "schema", str(entries["schema"]), SCHEMA)
    if str(entries["version"]) != str(SCHEMA_VERSION):
        expected = f"{SCHEMA_VERSION}; train it anew with this version of Catoptra"
        raise _config_error(path, "version", str(entries["version"]), expected)
    try:
        positives = {colour: Histogram(entries[colour]) for colour in BAND_COLOURS}
        negative, theta = Histogram(entries["neg"]), float(entries["theta"])
        return classifier_from_histograms(positives, negative, theta=theta)
    except DomainError as error:
        raise _config_error(path, "histograms", "unusable", str(error)) from error


def _config_error(path: Path, key: str, value: str, expected: str) -> ConfigError:
    return ConfigError(SourceLocation(str(path)), key=key, value=value, expected=expected)
