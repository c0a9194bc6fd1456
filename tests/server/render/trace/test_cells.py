"""The cells of an image and the rays that belong to them."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.ray_samples import omni_rays
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=62)


def make_grid(*, samples: int = 1, side_px: int = 4) -> CellGrid:
    rays = omni_rays(CAMERA, make_plan(CAMERA, samples=samples))
    return CellGrid.from_camera(CAMERA, rays, side_px=side_px)


@pytest.mark.parametrize("side_px", [2, 4, 5])
@pytest.mark.parametrize("samples", [1, 2])
def test_cells_and_other_pixels_have_every_ray_once(samples: int, side_px: int) -> None:
    rays = omni_rays(CAMERA, make_plan(CAMERA, samples=samples))
    grid = make_grid(samples=samples, side_px=side_px)
    pixels = np.concatenate((grid.pixels.reshape(-1), grid.others.pixels))
    directions = np.concatenate((grid.directions.reshape(-1, 3), grid.others.directions))
    order = np.argsort(pixels)
    np.testing.assert_array_equal(pixels[order], rays.pixels)
    by_pixel = directions.reshape(-1, samples**2, 3)[order]
    np.testing.assert_array_equal(by_pixel.reshape(-1, 3), rays.directions)


def test_pixels_of_a_cell_are_a_square_of_the_image() -> None:
    grid = make_grid()
    cell = 7 * grid.columns + 6
    v, u = np.divmod(grid.pixels[grid.row_of[cell]], 62)
    assert sorted(set(v)) == [28, 29, 30, 31]
    assert sorted(set(u)) == [24, 25, 26, 27]


def test_rays_through_corners_are_those_of_the_mirror() -> None:
    grid = make_grid()
    row, column = np.divmod(grid.nodes, grid.columns + 1)
    pixel = 4.0 * np.stack((column, row), axis=-1)
    expected, valid = direction_from_pixel(CAMERA, pixel)
    assert valid.all()
    np.testing.assert_allclose(grid.node_rays, expected, atol=1e-7)


def test_samples_of_a_cell_lie_within_the_pyramid_of_its_corners() -> None:
    grid = make_grid(samples=4)
    v, u = np.mgrid[: grid.rows + 1, : grid.columns + 1] * 4.0
    corners, _ = direction_from_pixel(CAMERA, np.stack((u, v), axis=-1))
    for cell in np.flatnonzero(grid.row_of >= 0):
        row, column = divmod(int(cell), grid.columns)
        a, b = corners[row, column], corners[row, column + 1]
        c, d = corners[row + 1, column + 1], corners[row + 1, column]
        sides = np.cross([a, b, c, d], [b, c, d, a])
        towards = grid.directions[grid.row_of[cell]].astype(float) @ sides.T
        assert (towards > 0.0).all() or (towards < 0.0).all()


def test_cone_of_a_cell_contains_its_rays() -> None:
    grid = make_grid(samples=2)
    cosine = np.einsum("cmi,ci->cm", grid.directions, grid.cone_axes).min(axis=1)
    assert (cosine >= np.cos(grid.reach_rad) - 1e-6).all()


def test_cells_agree_where_all_four_corners_do() -> None:
    grid = make_grid()
    at_nodes = np.zeros((grid.rows + 1, grid.columns + 1), dtype=np.int32)
    at_nodes[3, 5] = 9
    agree = grid.has_equal_nodes(at_nodes.reshape(-1)).reshape(grid.rows, grid.columns)
    assert {(int(r), int(c)) for r, c in np.argwhere(~agree)} == {(2, 4), (2, 5), (3, 4), (3, 5)}
    first = grid.first_node(at_nodes.reshape(-1)).reshape(grid.rows, grid.columns)
    assert np.argwhere(first == 9).tolist() == [[3, 5]]
