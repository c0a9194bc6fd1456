from __future__ import annotations

import math

from catoptra_server.effects.scene_summary import RINGS, SceneSummary

NEAR = (0.5, *(2.0,) * (RINGS - 1))
OWN = (*(0.3,) * 2, *(math.inf,) * (RINGS - 2))


def test_what_is_in_view_is_the_nearer_of_scene_and_what_the_camera_carries() -> None:
    summary = SceneSummary(1.0, nearest_m=NEAR, carried_m=OWN)
    assert summary.in_view_m == (0.3, 0.3, *(2.0,) * (RINGS - 2))


def test_what_is_in_view_when_nothing_is_carried_is_the_scene() -> None:
    assert SceneSummary(1.0, nearest_m=NEAR).in_view_m == NEAR
