"""The frame that is shown of a film."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_client.experiment.degraded.sample import changed, sample
from helpers.films import ASIDE, CAMERA, NEAR, film, shot, sighting


def test_sample_is_the_first_of_the_fullest_frames_with_its_marks() -> None:
    there = film(shot(NEAR), shot(NEAR, ASIDE), shot(NEAR, ASIDE))
    found = [(), (sighting("near", 1.0, 0.0), sighting("aside", 2.0, 20.0)), ()]
    shown = sample(there, found)
    assert shown.frame is there.shots[1].frame
    assert shown.found == ((NEAR.x_m, NEAR.y_m),)
    assert shown.missed == ((ASIDE.x_m, ASIDE.y_m),)
    assert shown.false_rad == (math.radians(20.0),)
    assert shown.centre_px == CAMERA.centre_px


def test_change_is_the_rms_of_all_levels_whichever_is_brighter() -> None:
    clean = sample(film(shot(NEAR)), [()])
    frame = clean.frame.copy()
    frame[0, 0] = 200
    worse = replace(clean, frame=frame)
    rms = pytest.approx(200.0 / np.sqrt(40 * 40))
    assert changed(worse, clean) == changed(clean, worse) == rms
    assert changed(clean, clean) == 0.0
