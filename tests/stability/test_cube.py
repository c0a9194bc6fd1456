"""Cube faces: every edge and corner has one face, and coordinates there are exact."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics import cube_map
from catoptra_protocol.optics.numerics import Floats
from stability.catalogue import Case, check, load


def _face(direction: list[float]) -> int:
    return int(cube_map.face_from_direction(np.array(direction)))


def _coordinates(direction: list[float], face: int) -> Floats:
    return cube_map.face_coordinates(np.array(direction), np.array(face))


SUBJECTS = {"face_from_direction": _face, "face_coordinates": _coordinates}


@pytest.mark.parametrize("case", load("cube"), ids=str)
def test_face_when_at_a_hard_case_is_the_first_of_the_largest(case: Case) -> None:
    check(case, SUBJECTS)
