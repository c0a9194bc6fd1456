from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_studies.camera_figures.mirror_drawing import mirror_points, sample_cube
from catoptra_studies.study_subject import StudySubject

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
