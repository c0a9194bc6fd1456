"""Mirror meshes: on Eq. 1's surface, of the right area, with the directions of their corners.

The effect on the image is measured in tests/studies/camera_figures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import (
    MIRROR_FROM_FACE_ROTATIONS,
    face_coordinates,
    face_from_direction,
)
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.world.mirror_mesh import (
    Interpolation,
    Tessellation,
    build_mirror_mesh,
    mirror_polygons,
    tessellation_from_polygon_count,
)
from helpers.worlds import make_omni_camera

TESSELLATIONS = [Tessellation(4, 4), Tessellation(8, 2), Tessellation(32, 32), Tessellation(3, 1)]
CAMERA = make_omni_camera()


def image_corners(camera: OmniCamera, corners: Floats) -> Floats:
    """(..., 2) corners in the image plane, in units of the 90-degree circle."""
    scale = PAPER_MIRROR.s
    return scale * corners[..., :2] / (camera.mirror.pinhole_distance_m - corners[..., 2:])


@pytest.mark.parametrize("tessellation", TESSELLATIONS, ids=str)
def test_corners_lie_on_eq_1(tessellation: Tessellation) -> None:
    corners = build_mirror_mesh(CAMERA, tessellation).corners
    k, c = PAPER_MIRROR.k, PAPER_MIRROR.c_m
    r = np.hypot(corners[..., 0], corners[..., 1])
    residual = (corners[..., 2] - 0.5 * c) ** 2 - r**2 * (0.5 * k - 1) - 0.25 * c * c * (k - 2) / k
    np.testing.assert_allclose(residual / c**2, 0.0, atol=1e-15)


@pytest.mark.parametrize("tessellation", TESSELLATIONS, ids=str)
def test_triangles_are_s_times_2r_minus_1(tessellation: Tessellation) -> None:
    mesh = build_mirror_mesh(CAMERA, tessellation)
    assert len(mesh.corners) == tessellation.sectors * (2 * tessellation.rings - 1)
    assert len(mirror_polygons(CAMERA, tessellation)) == tessellation.num_polygons


@pytest.mark.parametrize("tessellation", TESSELLATIONS, ids=str)
def test_mesh_in_the_image_covers_its_rim_polygon(tessellation: Tessellation) -> None:
    points = image_corners(CAMERA, build_mirror_mesh(CAMERA, tessellation).corners)
    a, b = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    rim = CAMERA.rim_radius_px / CAMERA.horizon_radius_px
    s = tessellation.sectors
    # Derived: (S / 2 pi) sin(2 pi / S) of the disc; no overlap, no hole.
    covered = s / (2.0 * math.pi) * math.sin(2.0 * math.pi / s)
    assert area / (math.pi * rim**2) == pytest.approx(covered, rel=1e-12)


def test_rings_are_equal_in_image_radius() -> None:
    corners = mirror_polygons(CAMERA, Tessellation(8, 5))
    radii = np.unique(np.round(np.linalg.norm(image_corners(CAMERA, corners), axis=-1), 9))
    np.testing.assert_allclose(np.diff(radii), radii[-1] / 5, atol=2e-9)


@pytest.mark.parametrize("sectors", [8, 16, 64])
def test_borders_of_a_multiple_of_8_sectors_are_on_the_cube_edges(sectors: int) -> None:
    azimuth = np.degrees(
        np.arctan2(*mirror_polygons(CAMERA, Tessellation(sectors, 2))[..., 1::-1].T)
    )
    for edge in (45.0, 135.0, -45.0, -135.0):
        assert np.isclose(azimuth, edge).any()


def test_directions_by_position_are_the_corners() -> None:
    mesh = build_mirror_mesh(CAMERA, Tessellation(8, 8, Interpolation.POSITION))
    np.testing.assert_array_equal(mesh.directions, mesh.corners)


@pytest.mark.parametrize("tessellation", [Tessellation(32, 32), Tessellation(8, 8)], ids=str)
def test_directions_by_uv_lie_on_the_plane_of_one_face(tessellation: Tessellation) -> None:
    mesh = build_mirror_mesh(CAMERA, tessellation)
    unit = mesh.corners / np.linalg.norm(mesh.corners, axis=-1, keepdims=True)
    looked_up = mesh.directions / np.linalg.norm(mesh.directions, axis=-1, keepdims=True)
    np.testing.assert_allclose(looked_up, unit, atol=1e-14)
    # A plane at distance 1: some face's forward component is 1 in all three corners.
    forward = np.einsum("nci,fi->nfc", mesh.directions, MIRROR_FROM_FACE_ROTATIONS[:, :, 0])
    assert np.isclose(forward, 1.0, atol=1e-12).all(axis=2).any(axis=1).all()


def test_face_of_a_polygon_is_the_one_around_its_centre() -> None:
    mesh = build_mirror_mesh(CAMERA, Tessellation(64, 64))
    mean = mesh.directions.sum(axis=1)
    face = face_from_direction(mean)
    coordinates = face_coordinates(mesh.directions.reshape(-1, 3), np.repeat(face, 3))
    # A polygon may reach over its face's edge by what its size is.
    assert np.abs(coordinates).max() < 1.2


@pytest.mark.parametrize(
    ("camera", "tessellation"),
    [
        (make_omni_camera(rim_deg=150.0), Tessellation(8, 4)),
        (make_omni_camera(rim_deg=30.0), Tessellation(8, 4)),
        (make_omni_camera(mirror=ParabolicMirror(0.05)), Tessellation(16, 4)),
        (make_omni_camera(mirror=HyperbolicMirror(1e6, 1.0)), Tessellation(16, 4)),
        (CAMERA, Tessellation(4096, 1)),
        (CAMERA, Tessellation(3, 400)),
    ],
)
def test_mesh_of_extreme_mirrors_and_tessellations_is_finite(
    camera: OmniCamera, tessellation: Tessellation
) -> None:
    mesh = build_mirror_mesh(camera, tessellation)
    assert np.isfinite(mesh.corners).all()
    assert np.isfinite(mesh.directions).all()


def test_mesh_is_read_only() -> None:
    mesh = build_mirror_mesh(CAMERA, Tessellation(8, 8))
    with pytest.raises(ValueError, match="read-only"):
        mesh.directions[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    ("polygons", "tessellation"),
    [
        (16, (4, 4)),
        (64, (8, 8)),
        (256, (16, 16)),
        (1024, (32, 32)),
        (4096, (64, 64)),
        (4, (4, 1)),
        (512, (64, 8)),
        (7, (7, 1)),
    ],
)
def test_tessellation_from_a_count_has_that_many_polygons(
    polygons: int, tessellation: tuple[int, int]
) -> None:
    made = tessellation_from_polygon_count(polygons)
    assert made.num_polygons == polygons
    assert (made.sectors, made.rings) == tessellation


def test_tessellation_from_any_count_is_valid() -> None:
    assert [tessellation_from_polygon_count(n).num_polygons for n in range(3, 300)] == list(
        range(3, 300)
    )


@pytest.mark.parametrize(("sectors", "rings"), [(2, 4), (8, 0), (-8, -2), (0, 0)])
def test_degenerate_tessellation_is_rejected(sectors: int, rings: int) -> None:
    with pytest.raises(DomainError, match="at least 3 x 1"):
        Tessellation(sectors, rings)
