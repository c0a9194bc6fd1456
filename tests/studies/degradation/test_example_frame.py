"""The frame that is shown of a film."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_studies.degradation.example_frame import rms_difference, select_example
from helpers.recorded_drives import CAMERA, NEAR, SIDE, make_detection, make_drive, make_frame


def test_sample_is_the_first_of_the_fullest_frames_with_its_marks() -> None:
    there = make_drive(make_frame(NEAR), make_frame(NEAR, SIDE), make_frame(NEAR, SIDE))
    found = [(), (make_detection("near", 1.0, 0.0), make_detection("aside", 2.0, 20.0)), ()]
    shown = select_example(there, found)
    assert shown.rgb is there.frames[1].rgb
    assert shown.detected_px == ((NEAR.x_m, NEAR.y_m),)
    assert shown.missed_px == ((SIDE.x_m, SIDE.y_m),)
    assert shown.false_bearings_rad == (math.radians(20.0),)
    assert shown.centre_px == CAMERA.centre_px


def test_change_is_the_rms_of_all_levels_whichever_is_brighter() -> None:
    clean = select_example(make_drive(make_frame(NEAR)), [()])
    frame = clean.rgb.copy()
    frame[0, 0] = 200
    worse = replace(clean, rgb=frame)
    rms = pytest.approx(200.0 / np.sqrt(40 * 40))
    assert rms_difference(worse, clean) == rms_difference(clean, worse) == rms
    assert rms_difference(clean, clean) == 0.0
