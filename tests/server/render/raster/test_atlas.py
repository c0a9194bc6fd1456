from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube import FACE_AXES, Face, face_coordinates, face_from_direction
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.atlas import Atlas, pack_atlas, seen_window

FIVE = (Face.N, Face.E, Face.S, Face.W, Face.C)


def atlas(
    limit_deg: float, *, faces: tuple[Face, ...] = FIVE, size: int = 64, max_texels: int = 16384
) -> Atlas:
    limit_rad = math.radians(limit_deg)
    return pack_atlas(faces, size=size, limit_rad=limit_rad, guard=2, max_texels=max_texels)


def directions_up_to(limit_deg: float) -> Floats:
    theta = np.radians(np.linspace(0.0, limit_deg, 181))
    gamma = np.radians(np.linspace(-180.0, 180.0, 361))
    theta, gamma = np.meshgrid(theta, gamma, indexing="ij")
    ring = np.sin(theta)
    grid = np.stack((ring * np.cos(gamma), ring * np.sin(gamma), np.cos(theta)), axis=-1)
    return grid.reshape(-1, 3)


@pytest.mark.parametrize("limit_deg", [30.0, 44.9, 45.1, 60.0, 89.0, 90.0, 91.0, 120.0, 125.2])
def test_windows_hold_every_direction_up_to_the_limit(limit_deg: float) -> None:
    directions = directions_up_to(limit_deg)
    face = face_from_direction(directions)
    st = face_coordinates(directions, face)
    for index in np.unique(face):
        window = seen_window(Face(index), math.radians(limit_deg))
        s, t = st[face == index].T
        assert window.left - 1e-9 <= s.min()
        assert s.max() <= window.right + 1e-9
        assert window.top - 1e-9 <= t.min()
        assert t.max() <= window.bottom + 1e-9


@pytest.mark.parametrize(
    ("limit_deg", "cells"), [(30.0, 1), (44.0, 1), (46.0, 5), (120.0, 5), (125.0, 5)]
)
def test_faces_that_nothing_sees_have_no_cell(limit_deg: float, cells: int) -> None:
    assert len(atlas(limit_deg).cells) == cells


def test_rows_above_the_rim_have_no_texels() -> None:
    # t = -tan 30 deg sqrt 2 = -0.816: 26 of 32 rows above the horizon, 32 below, twice the guard.
    side = atlas(120.0).cells[0]
    assert side.height == math.ceil(32 * (1.0 + math.tan(math.radians(30.0)) * math.sqrt(2.0))) + 4
    assert side.width == 68


def test_cells_do_not_overlap_and_fill_their_texture() -> None:
    packed = atlas(130.0, faces=(*FIVE, Face.U), max_texels=3 * 68)
    covered = np.zeros((packed.height, packed.width), dtype=int)
    for cell in packed.cells:
        covered[cell.y : cell.y + cell.height, cell.x : cell.x + cell.width] += 1
    assert covered.shape == (2 * 68, 3 * 68)
    assert (covered == 1).all()


@pytest.mark.parametrize("face", list(Face))
def test_projection_puts_a_direction_on_its_texel(face: Face) -> None:
    packed = atlas(130.0, faces=(*FIVE, Face.U))
    cell = next(cell for cell in packed.cells if cell.face is face)
    st = np.array([[-1.0, -1.0], [1.0, 0.3], [0.0, 0.0], [0.2, -0.9]])
    directions = np.column_stack((np.ones(len(st)), st)) @ FACE_AXES[face].T
    x, y, w = cell.clip_from_mirror @ (2.5 * directions.T)
    texel_x = cell.x + 0.5 * (x / w + 1.0) * cell.width
    texel_y = cell.y + 0.5 * (y / w + 1.0) * cell.height
    expected = np.asarray(cell.centre) + st * 0.5 * packed.face_size
    assert np.column_stack((texel_x, texel_y)) == pytest.approx(expected, abs=1e-9)


def test_spread_is_the_distance_of_the_farthest_corner_one_metre_ahead() -> None:
    cell = atlas(130.0, faces=(*FIVE, Face.U)).cells[0]
    edge = 1.0 + 2.0 * 2 / 64
    assert cell.spread == pytest.approx(math.sqrt(1.0 + 2.0 * edge**2))


@pytest.mark.parametrize(("size", "limit"), [(17000, 16384), (9000, 16384)])
def test_pack_when_the_device_is_too_small_says_its_limit(size: int, limit: int) -> None:
    with pytest.raises(DomainError, match=str(limit)):
        atlas(120.0, size=size, max_texels=limit)
