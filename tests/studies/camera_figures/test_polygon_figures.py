"""Mirror meshes of world/mirror_mesh against an independent reference.

The displacements of the same reference are compared in accuracy_cost/test_cost_study.py.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from catoptra_studies.camera_figures.polygon_figures import (
    find_max_difference_window,
    measure_polygon_error,
)
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)


@pytest.mark.parametrize(
    ("sectors", "rings", "covered"),
    [
        *((4, 4, 0.634), (8, 8, 0.900), (16, 16, 0.975), (32, 32, 0.994), (64, 64, 0.999)),
        *((16, 4, 0.975), (32, 8, 0.994), (64, 16, 0.999)),
    ],
)
def test_mesh_covers_as_much_as_the_reference(sectors: int, rings: int, covered: float) -> None:
    error = measure_polygon_error(CAMERA, Tessellation(sectors, rings, Interpolation.POSITION))
    assert error.coverage == pytest.approx(covered, abs=0.001)


@pytest.mark.parametrize("interpolation", Interpolation)
def test_error_falls_as_one_over_the_number_of_polygons(interpolation: Interpolation) -> None:
    coarse, fine = (
        measure_polygon_error(CAMERA, Tessellation(n, n, interpolation)).rms_px for n in (16, 64)
    )
    order = math.log(coarse / fine) / math.log(16.0)

    # 1.00 +- 0.05 by the derivation of the reference table.
    assert order == pytest.approx(1.0, abs=0.05)


def test_window_surrounds_what_differs_within_the_radius() -> None:
    reference = np.zeros((100, 100, 3), dtype=np.uint8)
    image = reference.copy()
    image[40:44, 60:64] = 200
    image[2:20, 2:20] = 255  # differs more, but beyond the radius

    row, column = find_max_difference_window(image, reference, 16, max_radius_px=40.0)

    assert row <= 40
    assert row + 16 >= 44
    assert column <= 60
    assert column + 16 >= 64
