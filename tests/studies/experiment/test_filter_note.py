"""The note of a filter: the keys that viewers draw, and a size that every server accepts."""

from __future__ import annotations

import json
import math

import pytest

from catoptra_client.localization import LandmarkPosition, OdometryPose
from catoptra_protocol.notes import text_from_note
from catoptra_studies.experiment.drive_log import DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER
from catoptra_studies.experiment.localization_filter import (
    NOTE_NAME,
    FilterStep,
    advance_filter,
    begin_filter,
    note_from_filter_step,
)
from catoptra_studies.experiment.route import Waypoint

MAP = {"a": LandmarkPosition("a", 2.0, 0.0), "b": LandmarkPosition("b", 0.0, 2.0)}


def make_filter_step() -> FilterStep:
    """A robot that stands 5 cm beside its belief and measures one landmark right, one wrong."""
    still = OdometryPose(0.0, 0.0, 0.0)
    start = DriveStep(Waypoint(0.0, 0.0, 0.0), still, ())
    measured = (LandmarkMeasurement("a", 2.0, 0.0), LandmarkMeasurement("b", 2.0, 0.0))
    step = DriveStep(Waypoint(0.03, 0.04, 0.0), still, measured)
    begun = begin_filter(start, CONSISTENT_FILTER, heading_error_rad=0.0)
    return advance_filter(begun, step, CONSISTENT_FILTER, MAP)


def test_note_has_the_belief_and_the_gates_decisions():
    step = make_filter_step()
    note = json.loads(text_from_note(NOTE_NAME, note_from_filter_step(step)))
    assert note["pose"] == pytest.approx(step.belief.mean)
    assert note["covariance"] == pytest.approx(step.belief.covariance.ravel())
    assert note["detections"] == [
        {"landmark": "a", "bearing_rad": 0.0, "range_m": 2.0, "accepted": True},
        {"landmark": "b", "bearing_rad": 0.0, "range_m": 2.0, "accepted": False},
    ]


def test_text_states_error_deviations_and_accepted_landmarks():
    text = note_from_filter_step(make_filter_step())["text"]
    assert isinstance(text, str)
    assert text.startswith("0.05 m from the truth, σ 0.0")
    assert text.endswith("the gate accepts 1 of 2 landmarks")


def test_note_of_fifty_landmarks_is_accepted():
    step = make_filter_step()
    names = [f"a beacon with a long name {number}" for number in range(50)]
    measured = tuple(LandmarkMeasurement(name, math.pi, -math.e) for name in names)
    many = FilterStep(
        DriveStep(step.drive_step.truth, step.drive_step.odometry, measured),
        step.belief,
        step.health,
        step.odometry_pose,
        step.updates[:1] * 50,
    )
    assert len(text_from_note(NOTE_NAME, note_from_filter_step(many))) > 4000
