"""The frame that is shown of a film."""

from __future__ import annotations

import math

from catoptra_client.experiment.degraded.sample import sample
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
