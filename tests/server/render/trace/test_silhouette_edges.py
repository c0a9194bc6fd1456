"""Edges through an image, and the cells that they cross."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.projection_table import ProjectionTable
from catoptra_server.render.trace.ray_samples import omni_rays
from catoptra_server.render.trace.silhouette_edges import SilhouetteEdges
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=200)
TABLE = ProjectionTable.from_camera(CAMERA)
POSE = Pose.from_rpy((0.5, -1.0, 2.0), (0.3, -0.2, 1.0))


def make_grid(side_px: int = 4) -> CellGrid:
    return CellGrid.from_camera(CAMERA, omni_rays(CAMERA, make_plan(CAMERA)), side_px=side_px)


def find_crossed(
    ends: Floats, grid: CellGrid, *, plane: tuple[float, float, float] = (0, 0, 0)
) -> set:
    """Cells that edges, given in the mirror frame, cross in front of m . d = 1 / far."""
    silhouettes = SilhouetteEdges(POSE.transform_points(ends), TABLE, grid)
    vectors = np.tile(np.float32(plane), (grid.rows * grid.columns, 1))
    return set(silhouettes.find_cells(POSE, vectors).tolist())


def sample_cells(ends: Floats, grid: CellGrid) -> set[int]:
    """Cells of many points of an edge by the camera model."""
    along = np.linspace(0.0, 1.0, 20_001)[:, None]
    pixels, seen = pixel_from_direction(CAMERA, ends[0] + along * (ends[1] - ends[0]))
    column, row = np.floor(pixels[seen] / grid.side_px).astype(int).T
    inside = (column < grid.columns) & (row < grid.rows)
    return set((row * grid.columns + column)[inside].tolist())


@pytest.mark.parametrize("side_px", [2, 4, 9])
@pytest.mark.parametrize("seed", range(5))
def test_cells_that_an_edge_crosses_are_found_and_few_others(seed: int, side_px: int) -> None:
    rng = np.random.default_rng(seed)
    grid = make_grid(side_px)
    for _ in range(20):
        ends = rng.normal(size=(2, 3)) * rng.uniform(0.1, 10.0, (2, 1))
        expected = sample_cells(ends, grid)
        found = find_crossed(ends[None], grid)
        assert expected <= found
        assert len(found) <= 3 * len(expected) + 12


def test_edge_when_of_no_length_or_through_the_viewpoint_is_no_error() -> None:
    point = np.array([[[1.0, 0.2, 0.3], [1.0, 0.2, 0.3]]])
    through = np.array([[[1.0, 0.0, 0.5], [-1.0, 0.0, -0.5]], [[0, 0, 0], [0, 0, 1.0]]])
    assert sample_cells(point[0], make_grid()) <= find_crossed(point, make_grid())
    find_crossed(through, make_grid())


@pytest.mark.parametrize(("far_m", "is_hidden"), [(0.999, True), (1.0, False), (1.001, False)])
def test_edge_when_behind_a_plane_crosses_no_cell(far_m: float, is_hidden: bool) -> None:
    # An edge on the plane x = 1 m; a surface at x = far occludes the edge, or does not.
    ends = np.array([[[1.0, -0.5, 0.2], [1.0, 0.5, 0.6]]])
    assert (not find_crossed(ends, make_grid(), plane=(1.0 / far_m, 0.0, 0.0))) == is_hidden


def test_edge_when_it_leaves_a_plane_crosses_cells_from_there_on() -> None:
    ends = np.array([[[2.0, -0.8, 0.5], [0.5, 0.4, 0.5]]])
    whole = ends[0]
    share = (2.0 - 1.0) / 1.5
    out = np.array([whole[0] + share * (whole[1] - whole[0]), whole[1]])
    found = find_crossed(ends, make_grid(), plane=(1.0, 0.0, 0.0))
    assert sample_cells(out, make_grid()) <= found
    assert len(found) < len(find_crossed(ends, make_grid()))
