"""Error of mirror meshes against a reference table.

Tolerances are the table's own: position rms 3 %, max 5 %; UV 15 %, where face and diagonal are
free; order of convergence 1.00 within 0.05."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.frames.plan import facet_error as module
from catoptra_server.frames.plan.facet_error import (
    NUM_RADII,
    GeometricError,
    apply_floor,
    facet_errors,
    rim_gap,
    sum_errors,
)
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)
# sectors, rings, position: max and rms in degrees, max and rms in px; uv: max and rms in px
TABLE = [
    (4, 4, 28.05, 15.82, 91.8, 39.6, 91.3, 37.5),
    (8, 8, 6.107, 3.670, 21.28, 9.706, 24.6, 11.3),
    (16, 16, 1.475, 0.9005, 5.251, 2.422, 7.28, 2.95),
    (32, 32, 0.3658, 0.2240, 1.317, 0.6048, 2.03, 0.747),
    (64, 64, 0.0912, 0.0559, 0.3315, 0.1512, 0.543, 0.187),
    (16, 4, 2.436, 1.570, 6.606, 3.733, 10.2, 3.74),
    (32, 8, 0.6124, 0.3898, 1.727, 0.9279, 2.97, 0.959),
    (64, 16, 0.1532, 0.0973, 0.4431, 0.2317, 0.737, 0.241),
    (128, 32, 0.0383, 0.0243, 0.1121, 0.0579, 0.193, 0.0603),
]


def facet_error(camera: OmniCamera, tessellation: Tessellation) -> GeometricError:
    return facet_errors(camera, tessellation)


def position_tessellation(sectors: int, rings: int) -> Tessellation:
    return Tessellation(sectors, rings, Interpolation.POSITION)


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row[0]}x{row[1]}")
def test_error_of_position_interpolation_is_the_reference(row: tuple[float, ...]) -> None:
    sectors, rings, max_deg, rms_deg, max_px, rms_px, _, _ = row
    error = facet_error(CAMERA, position_tessellation(int(sectors), int(rings)))
    assert error.rms_px == pytest.approx(rms_px, rel=0.03)
    assert error.max_px == pytest.approx(max_px, rel=0.05)
    assert error.rms_deg == pytest.approx(rms_deg, rel=0.03)
    assert error.max_deg == pytest.approx(max_deg, rel=0.05)


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row[0]}x{row[1]}")
def test_error_of_uv_interpolation_is_the_reference(row: tuple[float, ...]) -> None:
    sectors, rings, *_, max_px, rms_px = row
    error = facet_error(CAMERA, Tessellation(int(sectors), int(rings)))
    assert error.rms_px == pytest.approx(rms_px, rel=0.15)
    assert error.max_px == pytest.approx(max_px, rel=0.15)


@pytest.mark.parametrize("interpolation", Interpolation)
def test_error_falls_as_one_over_the_number_of_polygons(interpolation: Interpolation) -> None:
    coarse, fine = (facet_error(CAMERA, Tessellation(n, n, interpolation)) for n in (16, 64))
    assert math.log(coarse.rms_px / fine.rms_px, 16.0) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("sectors", "rings"), [(64, 64), (128, 32), (300, 50)])
@pytest.mark.parametrize("k", [11.546, 1e4])
def test_largest_error_is_that_of_the_formula(k: float, sectors: int, rings: int) -> None:
    camera = make_omni_camera(mirror=HyperbolicMirror(k, 0.2), width_px=360)
    # Derived, within 2 % from 64 polygons on; here with the reserve of the bound.
    t = np.linspace(0.0, camera.rim_t, 400)
    below = (camera.rim_t / rings) ** 2 / 4.0 + np.square(t * math.pi / sectors)
    largest_px = camera.horizon_radius_px * (t * below / (1.0 + t * t)).max()
    error = facet_error(camera, position_tessellation(sectors, rings))
    assert error.max_px == pytest.approx(largest_px, rel=0.03)


@pytest.mark.parametrize("interpolation", Interpolation)
@pytest.mark.parametrize(("sectors", "rings"), [(3, 1), (4, 4), (6, 3), (8, 5), (12, 12)])
@pytest.mark.parametrize("rim_deg", [90.0, 150.0])
def test_bound_holds_on_a_finer_grid_of_every_sector(
    monkeypatch: pytest.MonkeyPatch,
    interpolation: Interpolation,
    sectors: int,
    rings: int,
    rim_deg: float,
) -> None:
    camera = make_omni_camera(width_px=360, rim_deg=rim_deg)
    tessellation = Tessellation(sectors, rings, interpolation)
    bound = facet_errors(camera, tessellation)
    steps = module._grid_steps(len(module._distinct_triangles(camera, tessellation)[0]))
    # Three times finer, the reserve taken off, no repetition relied on.
    monkeypatch.setattr(module, "_grid_steps", lambda num_triangles: 3 * steps)
    monkeypatch.setattr(
        module, "_num_distinct_sectors", lambda camera, tessellation: tessellation.sectors
    )
    reserve = (1.0 + math.pi / sectors / (3 * steps)) / (1.0 - 1.0 / (3 * steps) ** 2)
    finer = facet_errors.__wrapped__(camera, tessellation)
    assert finer.max_px / reserve <= bound.max_px <= 1.1 * finer.max_px
    assert finer.max_deg / reserve <= bound.max_deg <= 1.1 * finer.max_deg
    assert bound.rms_px == pytest.approx(finer.rms_px, rel=0.01)
    assert (np.array(finer.by_radius_px) / reserve <= bound.by_radius_px).all()


def test_error_does_not_depend_on_the_image_rotation() -> None:
    turned = replace(CAMERA, image_up_azimuth_rad=0.7)
    tessellation = Tessellation(10, 6)
    assert facet_error(turned, tessellation).max_px == pytest.approx(
        facet_error(CAMERA, tessellation).max_px
    )


@pytest.mark.parametrize("interpolation", Interpolation)
def test_whole_image_and_crop_agree(interpolation: Interpolation) -> None:
    # A hair beyond the border, and every sector is looked at, each with a part of the margin.
    tessellation = Tessellation(12, 8, interpolation)
    cropped = replace(CAMERA, centre_px=(180.0, 179.99))
    assert facet_error(cropped, tessellation).max_px == pytest.approx(
        facet_error(CAMERA, tessellation).max_px, rel=0.02
    )


def test_gap_is_the_sagitta_of_the_outer_borders() -> None:
    gap = rim_gap(CAMERA, Tessellation(16, 4))
    assert gap.max_px == pytest.approx(180.0 * (1.0 - math.cos(math.pi / 16)))
    assert gap.max_deg == pytest.approx(gap.max_px * 0.272, rel=0.02)
    assert rim_gap(CAMERA, Tessellation(10**6, 1)).max_px == pytest.approx(8.88e-10, rel=1e-3)


def test_mesh_under_an_orthographic_camera_is_rejected() -> None:
    with pytest.raises(DomainError, match="pinhole"):
        facet_error(make_omni_camera(mirror=ParabolicMirror(0.03)), Tessellation(8, 8))


@pytest.mark.parametrize("interpolation", Interpolation)
@pytest.mark.parametrize(("sectors", "rings"), [(4, 4), (16, 16), (32, 8)])
def test_error_by_radius_bounds_every_ring_and_its_largest_is_the_whole(
    sectors: int, rings: int, interpolation: Interpolation
) -> None:
    tessellation = Tessellation(sectors, rings, interpolation)
    by_radius = facet_errors(CAMERA, tessellation).by_radius_px
    assert len(by_radius) == NUM_RADII
    # Straight outer sides end within the rim: only there a ring may hold no facet.
    assert min(by_radius[: len(by_radius) // 2]) > 0.0
    assert max(by_radius) == pytest.approx(facet_error(CAMERA, tessellation).max_px)


def test_error_by_radius_grows_towards_the_rim_of_a_fine_mesh() -> None:
    by_radius = facet_errors(CAMERA, position_tessellation(64, 64)).by_radius_px
    assert by_radius[5] < 0.5 * by_radius[40]


FIRST = GeometricError(3.0, 0.3, 1.0, 0.05)
SECOND = GeometricError(1.0, 0.4, 2.0, 0.12)


def test_sum_adds_the_largest_and_squares_the_rms() -> None:
    rings = NUM_RADII * (4.0,)
    assert sum_errors((FIRST, SECOND)) == GeometricError(4.0, 0.5, 3.0, 0.13, rings)


def test_sum_is_as_large_as_in_its_worst_ring() -> None:
    inner, outer = (
        replace(FIRST, by_radius_px=(a, *(NUM_RADII - 2) * (0.0,), b))
        for a, b in ((1.0, 0.2), (0.1, 0.5))
    )
    added = sum_errors((inner, outer, SECOND))
    assert added.max_px == added.at_px(0.0) == pytest.approx(1.1 + SECOND.max_px)
    assert added.at_px(1.0) == pytest.approx(0.7 + SECOND.max_px)
    assert added.at_px(0.5) == SECOND.max_px


def test_sum_of_nothing_is_no_error() -> None:
    assert sum_errors(()) == GeometricError(0.0, 0.0, 0.0, 0.0)


def test_floor_raises_smaller_maxima_and_keeps_the_rms() -> None:
    assert apply_floor(FIRST, SECOND) == GeometricError(3.0, 0.3, 2.0, 0.05)
