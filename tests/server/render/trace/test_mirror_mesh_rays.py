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
from catoptra_server.render.trace.reference.triangle_search import TriangleSearch
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation, build_mirror_mesh
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


@pytest.mark.parametrize("interpolation", Interpolation)
@pytest.mark.parametrize(("sectors", "rings"), [(3, 1), (4, 4), (7, 5), (64, 64)])
def test_directions_are_those_of_the_facets_that_a_search_finds(
    sectors: int, rings: int, interpolation: Interpolation
) -> None:
    tessellation = Tessellation(sectors, rings, interpolation)
    directions, valid = mirror_mesh_directions(CAMERA, tessellation, PIXELS)
    exact, on_disc = direction_from_pixel(CAMERA, PIXELS)
    rho = np.hypot(exact[..., 0], exact[..., 1])
    r, z = CAMERA.mirror.surface_point(rho / (1.0 + exact[..., 2]))
    level = exact[..., :2] * (r / np.maximum(rho, 1e-9))[..., None]
    points = np.concatenate((level, z[..., None]), axis=-1)[on_disc]
    mesh = build_mirror_mesh(CAMERA, tessellation)
    pinhole = np.broadcast_to((0.0, 0.0, CAMERA.mirror.pinhole_distance_m), points.shape)
    _, facet, weights = TriangleSearch(mesh.corners).first_hits(pinhole, points - pinhole)
    np.testing.assert_array_equal(valid[on_disc], facet >= 0)
    a, b, c = mesh.directions[facet].swapaxes(0, 1)
    expected = a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    hits = np.flatnonzero(facet >= 0)
    np.testing.assert_allclose(directions[on_disc][hits], expected[hits], atol=1e-12)


def test_mirror_when_without_a_pinhole_is_rejected() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.05))
    with pytest.raises(DomainError, match="pinhole"):
        mirror_mesh_directions(camera, Tessellation(8, 8), PIXELS)
