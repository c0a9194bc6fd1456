"""A drive through detector and filter computes the same as the plain implementation did."""

from __future__ import annotations

import json
from typing import Any

import pytest

from catoptra_client.landmarks import ColourClassifier
from client.landmarks.recorded_drive import RECORD, compute_drive

# The numbers of one step follow from some thousand float64 operations, and those of a step from the
# belief of the step before: 8 steps may differ by a few thousand roundings, not by more.
TOLERANCE = {"rel": 1e-11, "abs": 1e-13}


@pytest.fixture(scope="module")
def drives(classifier: ColourClassifier) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Recorded and computed results, step by step."""
    recorded = json.loads(RECORD.read_text())
    return list(zip(recorded, compute_drive(classifier), strict=True))


def test_detections_equal_the_recorded_ones(drives) -> None:
    for recorded, computed in drives:
        assert [d[:3] for d in computed["detections"]] == [d[:3] for d in recorded["detections"]]
        for new, old in zip(computed["detections"], recorded["detections"], strict=True):
            assert new[3:] == pytest.approx(old[3:], **TOLERANCE)


def test_beliefs_and_decisions_of_the_gate_equal_the_recorded_ones(drives) -> None:
    for recorded, computed in drives:
        assert [u[0] for u in computed["updates"]] == [u[0] for u in recorded["updates"]]
        assert [u[1] for u in computed["updates"]] == pytest.approx(
            [u[1] for u in recorded["updates"]], rel=1e-9
        )
        assert computed["mean"] == pytest.approx(recorded["mean"], **TOLERANCE)
        assert computed["covariance"] == pytest.approx(recorded["covariance"], **TOLERANCE)
