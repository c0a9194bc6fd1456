"""Spheres and the cells that they may cover."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.cluster_marks import covered_cells
from catoptra_server.render.trace.projection_table import ProjectionTable
from catoptra_server.render.trace.ray_samples import omni_rays
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=200)
GRID = CellGrid.from_camera(CAMERA, omni_rays(CAMERA, make_plan(CAMERA)), side_px=4)
POSE = Pose.from_rpy((0.5, -1.0, 2.0), (0.3, -0.2, 1.0))


def find_covered(centre: Floats, radius_m: float) -> Floats:
    """Cells (rows, columns) that a sphere in the mirror frame covers."""
    centre, radius = POSE.transform_points(np.atleast_2d(centre)), np.array([radius_m])
    cells = covered_cells(
        centre, radius, pose=POSE, table=ProjectionTable.from_camera(CAMERA), grid=GRID
    )
    return cells.reshape(GRID.rows, GRID.columns)


@pytest.mark.parametrize("seed", range(8))
def test_cells_that_a_sphere_s_points_are_seen_in_are_covered(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(20):
        centre = rng.normal(size=3)
        radius = rng.uniform(0.01, 0.9) * np.linalg.norm(centre)
        points = rng.normal(size=(2000, 3))
        points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
        pixels, seen = pixel_from_direction(CAMERA, centre + points)
        column, row = np.floor(pixels[seen] / 4.0).astype(int).T
        assert find_covered(centre, radius)[row, column].all()


def test_sphere_when_small_covers_few_cells_and_when_invisible_none() -> None:
    assert 1 <= find_covered(np.array([1.0, 0.3, 0.2]), 0.01).sum() <= 4
    assert find_covered(np.array([0.1, 0.1, -1.0]), 0.05).sum() == 0


def test_sphere_when_around_the_viewpoint_covers_all() -> None:
    assert find_covered(np.array([0.1, 0.0, 0.0]), 0.2).all()
