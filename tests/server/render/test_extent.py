from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.render.extent import Extent
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import build_scene
from helpers.bodies import cube_at
from helpers.worlds import VIEW, room

AT = VIEW.world_from_mirror.translation
# Rounded up, to eighths of an octave.
COARSE = 2.0**0.125


def test_scene_when_looked_at_is_not_farther_than_is_told() -> None:
    scene = build_scene(room())
    farthest = float(np.linalg.norm(scene.corners - AT, axis=-1).max())
    assert farthest <= Extent(scene).farthest_m(AT, ()) <= 1.3 * COARSE * farthest


def test_body_when_it_is_beyond_the_scene_counts() -> None:
    far = cube_at(40.0, 0.0, 0.0)
    told = Extent(build_scene(room())).farthest_m(np.zeros(3), (far,))
    assert 40.2 <= told <= 41.0 * COARSE


def test_world_when_it_is_empty_has_nothing_far() -> None:
    empty = Extent(build_scene(World("nothing", ())))
    assert empty.farthest_m(AT, ()) == 0.0
    near = cube_at(1.0, 0.0, 0.0)
    assert empty.farthest_m(Pose.identity().translation, (near,)) == pytest.approx(1.3, rel=0.15)
