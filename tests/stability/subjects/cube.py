"""Cube faces: every edge and corner has one face, and coordinates there are exact."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics import cube_map
from catoptra_protocol.optics.numerics import Floats


def _face(direction: list[float]) -> int:
    return int(cube_map.face_from_direction(np.array(direction)))


def _coordinates(direction: list[float], face: int) -> Floats:
    return cube_map.face_coordinates(np.array(direction), np.array(face))


SUBJECTS = {"face_from_direction": _face, "face_coordinates": _coordinates}
