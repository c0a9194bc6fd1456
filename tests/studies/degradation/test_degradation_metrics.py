"""Metrics of drives against a truth made by hand; the example frame, the level that fails."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_client.landmarks import Detection
from catoptra_studies.degradation.degradation_metrics import (
    DegradationMetrics,
    compute_degradation_metrics,
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


def compute(*detections: tuple[Detection, ...]) -> DegradationMetrics:
    """Metrics of a drive that shows a near beacon, one aside and one out of range in each frame."""
    drive = make_drive(*(make_frame(NEAR, SIDE, FAR) for _ in detections))
    return compute_degradation_metrics([drive], [detections], setup=SETUP, landmarks=FIELD)


@pytest.mark.parametrize(
    ("name", "range_m", "bearing_deg", "num_detected", "num_false"),
    [
        ("near", 1.0, 4.9, 1, 0),
        ("near", 1.0, 5.1, 0, 1),
        ("near", 1.0, -5.1, 0, 1),
        ("far", 3.0, 180.0, 0, 0),
    ],
    ids=["near its bearing", "too far right", "too far left", "of a beacon out of range"],
)
def test_detection_is_correct_false_or_neither(
    name: str, range_m: float, bearing_deg: float, num_detected: int, num_false: int
) -> None:
    metrics = compute((make_detection(name, range_m, bearing_deg),))
    assert (metrics.num_visible, metrics.num_detected) == (2, num_detected)
    assert metrics.false_per_frame == num_false


def test_detection_of_a_beacon_that_is_not_visible_is_false() -> None:
    drive, detection = make_drive(make_frame(NEAR)), make_detection("aside", 2.0, 90.0)
    metrics = compute_degradation_metrics([drive], [[(detection,)]], setup=SETUP, landmarks=FIELD)
    assert (metrics.num_visible, metrics.false_per_frame) == (1, 1.0)


def test_metrics_have_rates_and_rms_errors() -> None:
    near, aside = make_detection("near", 1.03, 4.0), make_detection("aside", 1.99, 87.0)
    metrics = compute((near, aside), (), (make_detection("aside", 2.0, 20.0),), ())
    assert (metrics.num_frames, metrics.num_visible, metrics.num_detected) == (4, 8, 2)
    assert (metrics.detection_rate, metrics.false_per_frame) == (0.25, 0.25)
    assert metrics.range_rms_m == pytest.approx(math.hypot(0.03, 0.01) / math.sqrt(2.0))
    assert metrics.bearing_rms_deg == pytest.approx(5.0 / math.sqrt(2.0))


def test_metrics_when_nothing_was_detected_have_no_errors() -> None:
    metrics = compute((), ())
    assert (metrics.bearing_rms_deg, metrics.range_rms_m) == (None, None)
    assert (metrics.detection_rate, metrics.ekf_max_m, metrics.odometry_max_m) == (0.0, 0.0, 0.0)


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


@pytest.mark.parametrize(
    ("levels", "failures"),
    [
        # Rates are relative to those of clean images.
        ({"a": (73, 0.2), "b": (71, 0.2), "c": (39, 0.2)}, ["b", "c", None, None]),
        ({"a": (80, 0.4), "b": (80, 0.41), "c": (80, 0.61)}, [None, None, "b", "c"]),
        # The first level counts, even if a later one is better.
        ({"a": (10, 0.7), "b": (80, 0.1)}, ["a"] * 4),
    ],
    ids=["rates", "errors", "first"],
)
def test_first_failing_level_is_found_in_each_way(
    levels: dict[str, tuple[int, float]], failures: list[str | None]
) -> None:
    measured = [(label, make_metrics(*numbers)) for label, numbers in levels.items()]
    assert find_failure_levels(CLEAN, measured) == dict(
        zip(
            (
                *("detection_below_90_percent", "detection_below_50_percent"),
                *("ekf_error_above_twice_clean", "ekf_error_above_paper"),
            ),
            failures,
            strict=True,
        )
    )
