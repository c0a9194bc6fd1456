"""Judgements of sightings, and figures over films, against a truth made by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from catoptra_client.landmarks import Detection
from catoptra_studies.degradation.degradation_metrics import (
    DegradationMetrics,
    compute_degradation_metrics,
    evaluate_drive,
)
from catoptra_studies.experiment.experiment_setups import SIM
from helpers.recorded_drives import FAR, FIELD, NEAR, SIDE, make_detection, make_drive, make_frame

# The filter believes the start as it is.
SETUP = replace(SIM, initial_heading_error_rad=0.0)


def judged_frame(*seen: Detection):
    (frame,) = evaluate_drive(make_drive(make_frame(NEAR, SIDE, FAR)), [seen])
    return frame


def numbers(*seen: tuple[Detection, ...]) -> DegradationMetrics:
    there = make_drive(*(make_frame(NEAR, SIDE) for _ in seen))
    return compute_degradation_metrics([there], [seen], setup=SETUP, landmarks=FIELD)


def test_beacons_when_beyond_the_used_range_are_not_asked_for() -> None:
    assert judged_frame().visible_beacons == {"near", "aside"}


def test_beacons_when_not_visible_are_not_asked_for_and_false() -> None:
    (frame,) = evaluate_drive(make_drive(make_frame(NEAR)), [(make_detection("aside", 2.0, 90.0),)])
    assert frame.visible_beacons == {"near"}
    assert [one.name for one in frame.false_detections] == ["aside"]


def test_sighting_when_where_it_should_be_is_found_with_its_errors() -> None:
    frame = judged_frame(make_detection("near", 1.1, 4.0), make_detection("aside", 1.9, 89.0))
    assert frame.detection_errors["near"] == pytest.approx((0.1, math.radians(4.0)))
    assert frame.detection_errors["aside"] == pytest.approx((-0.1, math.radians(-1.0)))
    assert frame.false_detections == ()


@pytest.mark.parametrize(("bearing_deg", "false"), [(4.9, 0), (5.1, 1), (-5.1, 1)])
def test_sighting_when_farther_off_than_five_degrees_is_false(bearing_deg, false) -> None:
    frame = judged_frame(make_detection("near", 1.0, bearing_deg))
    assert (len(frame.detection_errors), len(frame.false_detections)) == (1 - false, false)


def test_sighting_when_of_a_far_beacon_is_neither_found_nor_false() -> None:
    frame = judged_frame(make_detection("far", 3.0, 180.0))
    assert (frame.detection_errors, frame.false_detections) == ({}, ())


def test_figures_have_shares_and_rms_errors() -> None:
    got = numbers(
        (make_detection("near", 1.03, 4.0),), (), (make_detection("aside", 2.0, 20.0),), ()
    )
    assert (got.num_frames, got.num_visible, got.num_detected, got.detection_rate) == (
        4,
        8,
        1,
        0.125,
    )
    assert got.false_per_frame == 0.25
    assert got.range_rms_m == pytest.approx(0.03)
    assert got.bearing_rms_deg == pytest.approx(4.0)


def test_figures_when_nothing_was_found_have_no_errors() -> None:
    got = numbers((), ())
    assert (got.bearing_rms_deg, got.range_rms_m, got.detection_rate) == (None, None, 0.0)
    assert (got.ekf_max_m, got.odometry_max_m) == (0.0, 0.0)


def test_filter_when_sightings_mislead_it_errs_more_than_odometry() -> None:
    got = numbers(*[(make_detection("near", 1.2, 3.0), make_detection("aside", 2.2, 93.0))] * 5)
    # The start is believed to be certain and the robot stands: nothing is believed but that.
    assert got.ekf_final_m == pytest.approx(0.0, abs=1e-6)
    assert got.odometry_max_m == 0.0


def test_rate_when_nothing_was_visible_is_zero() -> None:
    got = compute_degradation_metrics(
        [make_drive(make_frame())], [((),)], setup=SETUP, landmarks=FIELD
    )
    assert (got.num_visible, got.detection_rate) == (0, 0.0)
