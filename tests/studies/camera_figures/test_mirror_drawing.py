from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_server.world.mirror_mesh import mirror_polygons, tessellation_from_polygon_count
from catoptra_studies.camera_figures.mirror_drawing import (
    Axonometry,
    mirror_points,
    sample_cube,
    shade,
)
from catoptra_studies.study_subject import StudySubject

FROM_BEHIND = Axonometry.from_view_angles(azimuth_deg=180.0, elevation_deg=0.0)
FROM_BELOW = Axonometry.from_view_angles(azimuth_deg=180.0, elevation_deg=-89.0)


def test_seen_from_behind_right_is_right_and_down_is_down() -> None:
    right, down = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])

    assert FROM_BEHIND.project(right) == pytest.approx([1.0, 0.0])
    assert FROM_BEHIND.project(down) == pytest.approx([0.0, -1.0])


def test_farthest_polygon_comes_first() -> None:
    square = np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1.0]])
    polygons = square + np.array([0.0, 5.0, -3.0])[:, None, None] * np.array([1.0, 0.0, 0.0])

    assert list(FROM_BEHIND.depth_order(polygons)) == [1, 0, 2]


def test_every_polygon_of_the_mirror_turns_its_reflecting_side_down(subject: StudySubject) -> None:
    polygons = mirror_polygons(subject.camera, tessellation_from_polygon_count(64))

    assert polygons.shape == (64, 4, 3)
    assert (FROM_BELOW.normals(polygons)[:, 2] > 0.0).all()


def test_shade_is_a_brightness() -> None:
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    towards, away, _ = shade(normals)

    assert 0.0 <= away < towards <= 1.0


PLAIN = {face: np.full((4, 4, 3), 10 * face, dtype=np.uint8) for face in Face}


def test_mirror_point_lies_in_the_direction_and_on_eq1(subject: StudySubject) -> None:
    direction = np.array([0.6, -0.3, 0.2])
    x, y, z = point = mirror_points(subject.camera, direction)

    assert np.cross(point, direction) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    k, c = PAPER_MIRROR.k, PAPER_MIRROR.c_m
    left = (z - c / 2) ** 2 - (x * x + y * y) * (k / 2 - 1)
    assert left == pytest.approx(c * c / 4 * (k - 2) / k, rel=1e-12)


@pytest.mark.parametrize(
    ("direction", "face"),
    [((1, 0, 0.2), Face.N), ((0, 1, 0.2), Face.E), ((-1, 0, 0.2), Face.S), ((0, 0, 1), Face.C)],
)
def test_direction_is_looked_up_on_its_face(
    direction: tuple[float, float, float], face: Face
) -> None:
    assert sample_cube(PLAIN, np.array([direction], dtype=float))[0, 0] == 10 * face
