"""The rays of the mirror mesh; their error is measured in tests/studies/camera_figures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=120)
PIXELS = pixel_sample_positions(CAMERA)[:, :, 0]


@pytest.mark.parametrize("sectors", [3, 4, 8, 16, 64])
def test_pixels_when_sectors_are_few_are_covered_as_their_polygon_is(sectors: int) -> None:
    _, valid = mirror_mesh_directions(CAMERA, Tessellation(sectors, 4), PIXELS)
    _, on_disc = direction_from_pixel(CAMERA, PIXELS)
    covered = sectors / (2.0 * math.pi) * math.sin(2.0 * math.pi / sectors)
    # Counted in pixels: the square of 4 sectors is 84.9 px wide and lies along their rows.
    assert valid.sum() / on_disc.sum() == pytest.approx(covered, abs=0.015)


def test_directions_when_valid_are_unit_and_else_the_axis() -> None:
    directions, valid = mirror_mesh_directions(CAMERA, Tessellation(4, 4), PIXELS)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-14)
    np.testing.assert_array_equal(directions[~valid], np.tile([0.0, 0.0, 1.0], ((~valid).sum(), 1)))


def test_directions_of_very_many_polygons_are_the_camera_model_s() -> None:
    tessellation = Tessellation(1024, 256, Interpolation.POSITION)
    directions, valid = mirror_mesh_directions(CAMERA, tessellation, PIXELS)
    exact, _ = direction_from_pixel(CAMERA, PIXELS)
    # Derived: an error of order 1 / N; 0.0912 degrees at N = 4096 is 2.5e-5 rad here.
    assert np.abs(directions - exact)[valid].max() < 2.5e-5


def test_mirror_when_without_a_pinhole_is_rejected() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.05))
    with pytest.raises(DomainError, match="pinhole"):
        mirror_mesh_directions(camera, Tessellation(8, 8), PIXELS)
