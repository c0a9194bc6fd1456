"""Metrics of drives against a truth made by hand; the example frame, the level that fails."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_client.landmarks import Detection
from catoptra_studies.degradation.degradation_metrics import (
    DegradationMetrics,
    FailureLevels,
    compute_degradation_metrics,
    evaluate_drive,
    find_failure_levels,
    rms_difference,
    select_example,
)
from catoptra_studies.experiment.experiment_setups import SIM
from helpers.recorded_drives import (
    CAMERA,
    FAR,
    FIELD,
    NEAR,
    SIDE,
    make_detection,
    make_drive,
    make_frame,
)

# The filter starts at the true pose.
SETUP = replace(SIM, initial_heading_error_rad=0.0)


def evaluate(*detections: Detection):
    (frame,) = evaluate_drive(make_drive(make_frame(NEAR, SIDE, FAR)), [detections])
    return frame


def compute(*detections: tuple[Detection, ...]) -> DegradationMetrics:
    drive = make_drive(*(make_frame(NEAR, SIDE) for _ in detections))
    return compute_degradation_metrics([drive], [detections], setup=SETUP, landmarks=FIELD)


def test_beacons_when_beyond_the_range_in_use_do_not_count() -> None:
    assert evaluate().visible_beacons == {"near", "aside"}


def test_detection_of_a_beacon_that_is_not_visible_is_false() -> None:
    (frame,) = evaluate_drive(make_drive(make_frame(NEAR)), [(make_detection("aside", 2.0, 90.0),)])
    assert frame.visible_beacons == {"near"}
    assert [one.name for one in frame.false_detections] == ["aside"]


def test_detection_when_near_its_bearing_has_its_errors() -> None:
    frame = evaluate(make_detection("near", 1.1, 4.0), make_detection("aside", 1.9, 89.0))
    assert frame.detection_errors["near"] == pytest.approx((0.1, math.radians(4.0)))
    assert frame.detection_errors["aside"] == pytest.approx((-0.1, math.radians(-1.0)))
    assert frame.false_detections == ()


@pytest.mark.parametrize(("bearing_deg", "false"), [(4.9, 0), (5.1, 1), (-5.1, 1)])
def test_detection_when_more_than_five_degrees_off_is_false(bearing_deg, false) -> None:
    frame = evaluate(make_detection("near", 1.0, bearing_deg))
    assert (len(frame.detection_errors), len(frame.false_detections)) == (1 - false, false)


def test_detection_of_a_far_beacon_is_neither_correct_nor_false() -> None:
    frame = evaluate(make_detection("far", 3.0, 180.0))
    assert (frame.detection_errors, frame.false_detections) == ({}, ())


def test_metrics_have_rates_and_rms_errors() -> None:
    metrics = compute(
        (make_detection("near", 1.03, 4.0),), (), (make_detection("aside", 2.0, 20.0),), ()
    )
    assert (
        metrics.num_frames,
        metrics.num_visible,
        metrics.num_detected,
        metrics.detection_rate,
    ) == (
        4,
        8,
        1,
        0.125,
    )
    assert metrics.false_per_frame == 0.25
    assert metrics.range_rms_m == pytest.approx(0.03)
    assert metrics.bearing_rms_deg == pytest.approx(4.0)


def test_metrics_when_nothing_was_detected_have_no_errors() -> None:
    metrics = compute((), ())
    assert (metrics.bearing_rms_deg, metrics.range_rms_m, metrics.detection_rate) == (
        None,
        None,
        0.0,
    )
    assert (metrics.ekf_max_m, metrics.odometry_max_m) == (0.0, 0.0)


def test_filter_when_its_start_is_certain_ignores_misleading_detections() -> None:
    metrics = compute(*[(make_detection("near", 1.2, 3.0), make_detection("aside", 2.2, 93.0))] * 5)
    # P0 = 0 and no motion: the covariance stays zero, and no measurement changes the estimate.
    assert metrics.ekf_final_m == pytest.approx(0.0, abs=1e-6)
    assert metrics.odometry_max_m == 0.0


def test_rate_when_nothing_was_visible_is_zero() -> None:
    metrics = compute_degradation_metrics(
        [make_drive(make_frame())], [((),)], setup=SETUP, landmarks=FIELD
    )
    assert (metrics.num_visible, metrics.detection_rate) == (0, 0.0)


def test_example_is_the_first_frame_with_the_most_visible_beacons() -> None:
    drive = make_drive(make_frame(NEAR), make_frame(NEAR, SIDE), make_frame(NEAR, SIDE))
    detections = [(), (make_detection("near", 1.0, 0.0), make_detection("aside", 2.0, 20.0)), ()]
    example = select_example(drive, detections)
    assert example.rgb is drive.frames[1].rgb
    assert example.detected_px == ((NEAR.x_m, NEAR.y_m),)
    assert example.missed_px == ((SIDE.x_m, SIDE.y_m),)
    assert example.false_bearings_rad == (math.radians(20.0),)
    assert example.centre_px == CAMERA.centre_px


def test_difference_is_the_rms_of_all_channels_whichever_is_brighter() -> None:
    clean = select_example(make_drive(make_frame(NEAR)), [()])
    frame = clean.rgb.copy()
    frame[0, 0] = 200
    worse = replace(clean, rgb=frame)
    rms = pytest.approx(200.0 / np.sqrt(40 * 40))
    assert rms_difference(worse, clean) == rms_difference(clean, worse) == rms
    assert rms_difference(clean, clean) == 0.0


def make_metrics(num_detected: int, ekf_max_m: float) -> DegradationMetrics:
    return DegradationMetrics(100, 100, num_detected, 0.0, 0.1, 0.02, ekf_max_m, 0.05, 2.0)


CLEAN = make_metrics(80, 0.2)


def test_rates_are_relative_to_those_of_clean_images() -> None:
    levels = [
        ("a", make_metrics(73, 0.2)),
        ("b", make_metrics(71, 0.2)),
        ("c", make_metrics(39, 0.2)),
    ]
    assert find_failure_levels(CLEAN, levels) == FailureLevels(
        detection_below_90_percent="b",
        detection_below_50_percent="c",
        ekf_error_above_twice_clean=None,
        ekf_error_above_paper=None,
    )


def test_errors_are_compared_with_clean_ones_and_the_papers_bound() -> None:
    levels = [
        ("a", make_metrics(80, 0.4)),
        ("b", make_metrics(80, 0.41)),
        ("c", make_metrics(80, 0.61)),
    ]
    assert find_failure_levels(CLEAN, levels) == FailureLevels(
        detection_below_90_percent=None,
        detection_below_50_percent=None,
        ekf_error_above_twice_clean="b",
        ekf_error_above_paper="c",
    )


def test_first_level_counts_when_a_later_one_is_better() -> None:
    levels = [("a", make_metrics(10, 0.7)), ("b", make_metrics(80, 0.1))]
    assert find_failure_levels(CLEAN, levels) == FailureLevels("a", "a", "a", "a")
