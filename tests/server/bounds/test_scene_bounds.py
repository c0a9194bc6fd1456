from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.scene_summarizer import SceneBounds
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.dynamic_objects import place_cube
from helpers.worlds import CAMERA_STATE, make_test_world

AT = CAMERA_STATE.world_from_mirror.translation
# Rounded up, to eighths of an octave.
COARSE = 2.0**0.125


def test_no_surface_is_farther_than_the_bound() -> None:
    scene = build_scene(make_test_world())
    farthest = float(np.linalg.norm(scene.corners - AT, axis=-1).max())
    assert farthest <= SceneBounds(scene).max_distance_m(AT, ()) <= 1.3 * COARSE * farthest


def test_object_beyond_the_scene_counts() -> None:
    far = place_cube(40.0, 0.0, 0.0)
    bound_m = SceneBounds(build_scene(make_test_world())).max_distance_m(np.zeros(3), (far,))
    assert 40.2 <= bound_m <= 41.0 * COARSE


def test_empty_world_has_distance_zero() -> None:
    empty = SceneBounds(build_scene(World("nothing", ())))
    assert empty.max_distance_m(AT, ()) == 0.0
    near = place_cube(1.0, 0.0, 0.0)
    assert empty.max_distance_m(Pose.identity().translation, (near,)) == pytest.approx(
        1.3, rel=0.15
    )
