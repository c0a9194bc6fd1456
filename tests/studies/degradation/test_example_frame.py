"""The frame of a drive that its plot shows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_studies.degradation.degradation_metrics import rms_difference, select_example
from helpers.recorded_drives import CAMERA, NEAR, SIDE, make_detection, make_drive, make_frame


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
