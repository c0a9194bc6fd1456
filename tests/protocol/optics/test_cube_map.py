"""Cube map: one face per direction, and coordinates that lead back to the direction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import (
    MAX_FIVE_FACE_RIM_RAD,
    MIRROR_FROM_FACE_ROTATIONS,
    Face,
    face_coordinates,
    face_from_direction,
    visible_faces,
)


def test_axes_when_listed_are_rotations_of_exact_quarters() -> None:
    for axes in MIRROR_FROM_FACE_ROTATIONS:
        np.testing.assert_array_equal(axes @ axes.T, np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert set(np.abs(axes).ravel()) == {0.0, 1.0}


@pytest.mark.parametrize(
    ("face", "forward", "right", "down"),
    [
        (Face.N, (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        (Face.E, (0, 1, 0), (-1, 0, 0), (0, 0, 1)),
        (Face.S, (-1, 0, 0), (0, -1, 0), (0, 0, 1)),
        (Face.W, (0, -1, 0), (1, 0, 0), (0, 0, 1)),
        (Face.C, (0, 0, 1), (0, 1, 0), (-1, 0, 0)),
        (Face.U, (0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ],
)
def test_face_when_named_as_in_usarsim_looks_there(
    face: Face, forward: tuple[int, ...], right: tuple[int, ...], down: tuple[int, ...]
) -> None:
    axes = np.array((forward, right, down)).T
    np.testing.assert_array_equal(MIRROR_FROM_FACE_ROTATIONS[face], axes)
    assert face_from_direction(np.array(forward, dtype=float)) == face


def test_direction_when_broadcast_keeps_its_shape() -> None:
    directions = np.random.default_rng(1).normal(size=(4, 5, 3))
    faces = face_from_direction(directions)
    assert faces.shape == (4, 5)
    assert face_coordinates(directions, faces).shape == (4, 5, 2)


def test_limit_of_five_faces_is_125_264_degrees() -> None:
    assert math.degrees(MAX_FIVE_FACE_RIM_RAD) == pytest.approx(125.264, abs=5e-4)


@pytest.mark.parametrize(("beyond_rad", "above"), [(-1e-9, False), (1e-9, True)])
def test_corner_of_a_side_face_is_the_limit(beyond_rad: float, above: bool) -> None:
    theta = MAX_FIVE_FACE_RIM_RAD + beyond_rad
    side = math.sin(theta) / math.sqrt(2.0)
    face = face_from_direction(np.array([side, side, math.cos(theta)]))
    assert bool(face == Face.U) is above
    assert (Face.U in visible_faces(theta)) is above


def test_upper_edge_of_a_side_face_reaches_135_degrees() -> None:
    theta = math.radians(134.999)
    assert face_from_direction(np.array([math.sin(theta), 0.0, math.cos(theta)])) == Face.N
