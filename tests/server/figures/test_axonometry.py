from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.figures.axonometry import Axonometry, shade
from catoptra_server.figures.subject import Subject
from catoptra_server.scene.mirror_mesh import mirror_polygons, split_for

FROM_BEHIND = Axonometry.of_viewer(azimuth_deg=180.0, elevation_deg=0.0)
FROM_BELOW = Axonometry.of_viewer(azimuth_deg=180.0, elevation_deg=-89.0)


def test_seen_from_behind_right_is_right_and_down_is_down() -> None:
    right, down = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])

    assert FROM_BEHIND.flat(right) == pytest.approx([1.0, 0.0])
    assert FROM_BEHIND.flat(down) == pytest.approx([0.0, -1.0])


def test_farthest_polygon_comes_first() -> None:
    square = np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1.0]])
    polygons = square + np.array([0.0, 5.0, -3.0])[:, None, None] * np.array([1.0, 0.0, 0.0])

    assert list(FROM_BEHIND.farthest_first(polygons)) == [1, 0, 2]


def test_every_polygon_of_the_mirror_turns_its_reflecting_side_down(subject: Subject) -> None:
    polygons = mirror_polygons(subject.camera, split_for(64))

    assert polygons.shape == (64, 4, 3)
    assert FROM_BELOW.faces_viewer(polygons).all()


def test_shade_is_a_brightness() -> None:
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    towards, away, _ = shade(normals)

    assert 0.0 <= away < towards <= 1.0
