"""Shared by the landmark tests: one classifier, trained once on a few synthetic frames."""

from __future__ import annotations

import pytest

from catoptra_client.landmarks import ColourClassifier
from client.landmarks.recorded_drive import train_classifier


@pytest.fixture(scope="session")
def classifier() -> ColourClassifier:
    """Classifier of the training poses; the tests' frames have other poses."""
    return train_classifier()
