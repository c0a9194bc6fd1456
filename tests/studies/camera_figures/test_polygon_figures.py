"""Mirror meshes of world/mirror_mesh against an independent reference table.

The table was made in float64 and again in OpenGL, for 360 x 360 pixels with the rim at 120 degrees.
Tolerances are the table's own: UV 15 % (which face a polygon uses is free), position rms 3 %, max
5 %; the covered area to one unit of its last digit.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from catoptra_studies.camera_figures.polygon_figures import (
    find_max_difference_window,
    measure_polygon_error,
)

CAMERA: OmniCamera = camera_with_inscribed_rim(
    PAPER_MIRROR, width_px=360, height_px=360, rim_rad=math.radians(120.0)
)
# sectors, rings, covered, position max and rms, uv max and rms
TABLE = [
    (4, 4, 0.634, 91.8, 39.6, 91.3, 37.5),
    (8, 8, 0.900, 21.28, 9.706, 24.6, 11.3),
    (16, 16, 0.975, 5.251, 2.422, 7.28, 2.95),
    (32, 32, 0.994, 1.317, 0.6048, 2.03, 0.747),
    (64, 64, 0.999, 0.3315, 0.1512, 0.543, 0.187),
    (16, 4, 0.975, 6.606, 3.733, 10.2, 3.74),
    (32, 8, 0.994, 1.727, 0.9279, 2.97, 0.959),
    (64, 16, 0.999, 0.4431, 0.2317, 0.737, 0.241),
]


@pytest.mark.parametrize(
    ("sectors", "rings", "covered", "max_px", "rms_px"), [r[:5] for r in TABLE]
)
def test_position_interpolation_errs_as_the_reference(
    sectors: int, rings: int, covered: float, max_px: float, rms_px: float
) -> None:
    error = measure_polygon_error(CAMERA, Tessellation(sectors, rings, Interpolation.POSITION))

    assert error.rms_px == pytest.approx(rms_px, rel=0.03)
    assert error.max_px == pytest.approx(max_px, rel=0.05)
    assert error.coverage == pytest.approx(covered, abs=0.001)


@pytest.mark.parametrize(("sectors", "rings", "max_px", "rms_px"), [r[:2] + r[5:] for r in TABLE])
def test_uv_interpolation_errs_as_the_reference(
    sectors: int, rings: int, max_px: float, rms_px: float
) -> None:
    error = measure_polygon_error(CAMERA, Tessellation(sectors, rings, Interpolation.UV))

    assert error.rms_px == pytest.approx(rms_px, rel=0.15)
    assert error.max_px == pytest.approx(max_px, rel=0.15)


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
