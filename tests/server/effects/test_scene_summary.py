from __future__ import annotations

import math

from catoptra_server.effects.effect import NUM_RINGS, SceneSummary

NEAR = (0.5, *(2.0,) * (NUM_RINGS - 1))
EGO_BODY_DISTANCES_M = (*(0.3,) * 2, *(math.inf,) * (NUM_RINGS - 2))


def test_visible_distance_is_the_nearer_of_scene_and_what_the_camera_carries() -> None:
    summary = SceneSummary(1.0, min_distances_m=NEAR, attached_min_distances_m=EGO_BODY_DISTANCES_M)
    assert summary.visible_min_distances_m == (0.3, 0.3, *(2.0,) * (NUM_RINGS - 2))


def test_visible_distance_when_nothing_is_carried_is_the_scene() -> None:
    assert SceneSummary(1.0, min_distances_m=NEAR).visible_min_distances_m == NEAR
