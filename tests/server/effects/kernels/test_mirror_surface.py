"""Mirror surfaces by closed forms; contaminants cover what they should, where they should."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.kernels.grey_levels import camera_noise_key, pcg3d
from catoptra_server.effects.kernels.mirror_surface import (
    ContaminantCells,
    Contaminants,
    mirror_surface_table,
    particle_cells,
    pixel_coverage,
    scratch_cells,
)
from catoptra_server.world.objects import NoiseSeed
from helpers.worlds import make_omni_camera

PAPER = make_omni_camera(width_px=360)
P_M = 0.03
PARABOLIC = make_omni_camera(mirror=ParabolicMirror(P_M), width_px=360)


def test_paraboloid_when_measured_has_its_closed_form_s_area() -> None:
    surface_table = mirror_surface_table(PARABOLIC)
    steep = (1.0 + np.square(surface_table.r_m / P_M)) ** 1.5 - 1.0
    area = 2.0 * math.pi * P_M**2 / 3.0 * steep
    assert surface_table.area_m2 == pytest.approx(area[-1], rel=1e-5)
    np.testing.assert_allclose(surface_table.area_fraction, area / area[-1], atol=1e-6)


def test_paraboloid_from_afar_is_foreshortened_by_its_slope() -> None:
    surface_table = mirror_surface_table(PARABOLIC)
    px_per_m = PARABOLIC.horizon_radius_px / P_M
    r_m = np.linspace(0.0, surface_table.r_m[-1], 37)
    radius_px, radial, tangential = surface_table.interpolate(r_m)
    np.testing.assert_allclose(radius_px, px_per_m * r_m, rtol=1e-9)
    np.testing.assert_allclose(tangential, px_per_m, rtol=1e-5)
    np.testing.assert_allclose(surface_table.plan_radial_px_per_m, px_per_m, rtol=1e-9)
    np.testing.assert_allclose(radial, px_per_m / np.hypot(1.0, r_m / P_M), rtol=1e-4)


def test_hyperboloid_from_the_pinhole_is_scaled_as_in_perspective() -> None:
    surface_table = mirror_surface_table(PAPER)
    # 1 m at the vertex, 221.6 mm from a pinhole of 1086 px; the rim is 85 mm wide.
    assert surface_table.tangential_px_per_m[0] == pytest.approx(
        1086.096 / (0.2321 - 0.01052871), rel=1e-4
    )
    assert surface_table.radial_px_per_m[0] == pytest.approx(
        surface_table.tangential_px_per_m[0], rel=1e-3
    )
    assert surface_table.r_m[-1] == pytest.approx(0.042536, abs=1e-6)
    assert surface_table.tangential_px_per_m[-1] == pytest.approx(
        180.0 / surface_table.r_m[-1], rel=1e-9
    )
    assert surface_table.max_px_per_m == pytest.approx(
        surface_table.tangential_px_per_m[0], rel=1e-3
    )
    assert surface_table.max_px2_per_m2 == pytest.approx(
        surface_table.tangential_px_per_m[0] ** 2, rel=1e-3
    )


def test_fraction_when_turned_back_is_the_radius() -> None:
    surface_table = mirror_surface_table(PAPER)
    r_m = surface_table.plan_radius_from_area_fraction(np.array([0.0, 0.2, 0.7, 1.0]))
    np.testing.assert_allclose(
        np.interp(r_m, surface_table.r_m, surface_table.area_fraction), [0, 0.2, 0.7, 1], atol=1e-6
    )


CAMERA = make_omni_camera(width_px=360)
SURFACE_TABLE = mirror_surface_table(CAMERA)
NOISE_KEY = camera_noise_key(NoiseSeed((3, 4)), "dust")
CONTAMINANTS = Contaminants(0.01, 2e-4, 5, 0.015, 1e-4)


def square_coverage(*cells: tuple[float, float, float]) -> Floats:
    u, v, side = np.array(cells).T
    return pixel_coverage(ContaminantCells(u, v, side), CAMERA)


def test_square_when_laid_over_pixels_covers_of_each_what_is_common() -> None:
    covered = square_coverage((10.25, 20.0, 0.5))
    np.testing.assert_allclose(covered[19:21, 9:12], [[0.0, 0.125, 0.0]] * 2)
    assert covered.sum() == pytest.approx(0.25)
    assert square_coverage((10.5, 20.5, 1.0))[20, 10] == 1.0


def test_squares_when_they_lie_on_each_other_cover_no_more_than_all() -> None:
    assert square_coverage((5.5, 5.5, 0.9), (5.5, 5.5, 0.9)).max() == 1.0


def test_square_when_beyond_the_border_is_cut() -> None:
    assert square_coverage((0.0, 40.5, 1.0), (400.0, 3.0, 1.0)).sum() == pytest.approx(0.5)


@pytest.mark.parametrize("cover", [1e-6, 1e-3, 0.05])
@pytest.mark.parametrize("diameter_m", [3e-5, 2e-4, 1e-3])
def test_particles_when_made_have_the_configured_coverage_and_mean(
    cover: float, diameter_m: float
) -> None:
    sizes = Contaminants(cover, diameter_m, 0, 0.01, 1e-4).particle_diameters_m(
        SURFACE_TABLE.area_m2
    )
    assert 0.25 * math.pi * np.square(sizes).sum() == pytest.approx(cover * SURFACE_TABLE.area_m2)
    if len(sizes) > 300:
        assert sizes.mean() == pytest.approx(diameter_m, rel=0.02)


def test_particles_when_there_would_be_too_many_are_larger() -> None:
    sizes = Contaminants(0.2, 1e-6, 0, 0.01, 1e-4).particle_diameters_m(SURFACE_TABLE.area_m2)
    assert len(sizes) == 2**19
    assert 0.25 * math.pi * np.square(sizes).sum() == pytest.approx(0.2 * SURFACE_TABLE.area_m2)


def test_mirror_when_clean_has_no_cells() -> None:
    clean = Contaminants(0.0, 2e-4, 0, 0.01, 1e-4)
    assert len(particle_cells(clean, CAMERA, SURFACE_TABLE, NOISE_KEY).u) == 0
    assert len(scratch_cells(clean, CAMERA, SURFACE_TABLE, NOISE_KEY).u) == 0


def single_particle() -> tuple[ContaminantCells, Floats]:
    """Cells of a particle of 4 mm, and (n, 2) px of its points projected from the pinhole."""
    diameter = 4e-3
    cover = 0.25 * math.pi * diameter**2 / SURFACE_TABLE.area_m2
    cells = particle_cells(
        Contaminants(cover, 1.0, 0, 0.01, 1e-4), CAMERA, SURFACE_TABLE, NOISE_KEY
    )
    fraction, turn, _ = (float(word[0] + 0.5) / 2.0**32 for word in pcg3d(*np.split(NOISE_KEY, 3)))
    r = float(SURFACE_TABLE.plan_radius_from_area_fraction(np.array(fraction)))
    t = np.interp(
        r, SURFACE_TABLE.r_m, np.linspace(0.0, CAMERA.rim_t, len(SURFACE_TABLE.r_m))
    ) + np.array([0, 1e-6])
    (r0, r1), (z0, z1) = CAMERA.mirror.surface_point(t)
    outward = np.array([r1 - r0, 0.0, z1 - z0])
    outward /= np.linalg.norm(outward)
    y, x = np.mgrid[-1:1:101j, -1:1:101j] * 0.5 * diameter
    inside = np.hypot(x, y) <= 0.5 * diameter
    places = np.array([r0, 0.0, z0]) + x[inside][:, None] * outward
    places[:, 1] += y[inside]
    projected = 1086.096 * places[:, :2] / (0.2321 - places[:, 2:])
    cosine, sine = math.cos(2 * math.pi * turn), math.sin(2 * math.pi * turn)
    return cells, projected @ np.array([[cosine, sine], [-sine, cosine]]) + 180.0


def test_image_of_a_particle_is_the_disc_on_the_surface_in_perspective() -> None:
    cells, projected = single_particle()
    places = np.stack((cells.u, cells.v), axis=-1)
    # To the first order in the particle's size: a twentieth of the mirror.
    np.testing.assert_allclose(places.mean(axis=0), projected.mean(axis=0), atol=0.2)
    expected = np.cov(projected.T)
    np.testing.assert_allclose(np.cov(places.T), expected, atol=0.03 * np.trace(expected))
    # Moments of an even ellipse: the root of their determinant over pi / 4, 4 pi times as much.
    area = 4.0 * math.pi * math.sqrt(np.linalg.det(expected))
    assert np.square(cells.side_px).sum() == pytest.approx(area, rel=0.03)
    covered = pixel_coverage(cells, CAMERA)
    assert covered.sum() == pytest.approx(area, rel=0.03)
    assert covered.max() == 1.0


def test_particles_when_many_lie_all_over_the_surface_alike() -> None:
    cells = particle_cells(
        Contaminants(0.01, 3e-5, 0, 0.01, 1e-4), CAMERA, SURFACE_TABLE, NOISE_KEY
    )
    radius_px = np.hypot(cells.u - 180.0, cells.v - 180.0)
    area = np.square(cells.side_px)
    assert len(area) > 20_000
    for within in (0.1, 0.4, 0.8):
        rim_px = float(
            np.interp(within, SURFACE_TABLE.area_fraction, SURFACE_TABLE.image_radius_px)
        )
        # Area of a cell on the surface, not in the image.
        _, along, across = SURFACE_TABLE.interpolate(
            np.interp(radius_px, SURFACE_TABLE.image_radius_px, SURFACE_TABLE.r_m)
        )
        on_surface = area / (along * across)
        fraction = on_surface[radius_px < rim_px].sum() / on_surface.sum()
        assert fraction == pytest.approx(within, abs=0.02)
    right = area[cells.u > 180.0].sum() / area.sum()
    assert right == pytest.approx(0.5, abs=0.02)


def test_image_of_a_scratch_has_its_length_and_width() -> None:
    one = Contaminants(0.0, 2e-4, 1, 0.01, 3e-4)
    cells = scratch_cells(
        one, CAMERA, SURFACE_TABLE, camera_noise_key(NoiseSeed((3, 5)), "scratches")
    )
    length = float(one.scratch_lengths_m()[0])
    r_m = np.interp(
        np.hypot(cells.u - 180.0, cells.v - 180.0), SURFACE_TABLE.image_radius_px, SURFACE_TABLE.r_m
    )
    outward, across = (
        np.interp(r_m, SURFACE_TABLE.r_m, SURFACE_TABLE.plan_radial_px_per_m),
        SURFACE_TABLE.interpolate(r_m)[2],
    )
    in_plan = np.square(cells.side_px) / (outward * across)
    places = np.stack((cells.u - 180.0, cells.v - 180.0)) / across
    width, along = np.sqrt(12.0 * np.linalg.eigvalsh(np.cov(places)))
    assert length == pytest.approx(0.01 * math.log(2.0))
    assert in_plan.sum() == pytest.approx(length * 3e-4, rel=1e-5)
    assert along == pytest.approx(length, rel=1e-2)
    # The centres of a few rows of cells spread a little less than the cells.
    assert width == pytest.approx(3e-4, rel=0.05)


def test_scratches_when_longer_than_the_mirror_end_at_its_rim() -> None:
    cells = scratch_cells(Contaminants(0.0, 2e-4, 3, 1.0, 1e-4), CAMERA, SURFACE_TABLE, NOISE_KEY)
    assert len(cells.u)
    assert np.hypot(cells.u - 180.0, cells.v - 180.0).max() <= 180.0 + 1e-9


@pytest.mark.parametrize("cells_of", [particle_cells, scratch_cells])
def test_positions_are_the_same_for_the_same_key_and_others_for_another(
    cells_of: type[particle_cells],
) -> None:
    again = cells_of(CONTAMINANTS, CAMERA, SURFACE_TABLE, NOISE_KEY.copy())
    first = cells_of(CONTAMINANTS, CAMERA, SURFACE_TABLE, NOISE_KEY)
    other = cells_of(CONTAMINANTS, CAMERA, SURFACE_TABLE, NOISE_KEY + np.uint32(1))
    np.testing.assert_array_equal(first.u, again.u)
    assert not np.isin(other.u[:50], first.u).any()
