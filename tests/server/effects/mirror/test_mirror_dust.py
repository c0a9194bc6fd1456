from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_server.effects import SceneSummary
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.kernels.mirror_surface import Contaminants, mirror_surface_table
from catoptra_server.effects.mirror.mirror_dust import MirrorDust, coverage_map, max_coverage
from catoptra_server.world.objects import NoiseSeed
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_effect_negligible,
    assert_effect_not_negligible,
    make_test_pattern,
    max_grey_level_change,
)
from helpers.long_cases import quick_cases
from helpers.worlds import make_omni_camera

LENS = Aperture(4.0, 7.4e-6, 0.0)
PINHOLE = Aperture(64.0, 7.4e-6, 0.0)
CONTAMINANTS = Contaminants(0.002, 2e-4, 2, 0.02, 5e-5)
WITHOUT_SCRATCHES = replace(CONTAMINANTS, num_scratches=0)
DUST = MirrorDust(CONTAMINANTS, 0.3, LENS)
CLEAN = MirrorDust(Contaminants(0.0, 2e-4, 0, 0.02, 5e-5), 0.3, LENS)
PAPER = make_omni_camera(width_px=360)
ON_MIRROR = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA))[1]


def test_image_in_a_clean_mirror_keeps_every_bit() -> None:
    image = make_test_pattern(2.0)
    np.testing.assert_array_equal(CLEAN.apply(image, CAMERA, CAPTURE_CONTEXT), image)


def test_pixel_when_nothing_lies_on_it_keeps_every_bit() -> None:
    image = make_test_pattern(2.0)
    bare = coverage_map(DUST, CAMERA, CAPTURE_CONTEXT.noise_seed.camera_key)[..., 0] == 0.0
    assert 0.1 < bare.mean() < 0.99
    np.testing.assert_array_equal(DUST.apply(image, CAMERA, CAPTURE_CONTEXT)[bare], image[bare])


def test_light_when_the_scene_is_even_and_dust_is_white_stays() -> None:
    even = 0.7 * np.ones((96, 96, 3)) * ON_MIRROR
    white = replace(DUST, albedo=1.0)
    np.testing.assert_allclose(white.apply(even, CAMERA, CAPTURE_CONTEXT), even, atol=1e-12)


def test_light_when_dust_is_black_is_lost_by_coverage() -> None:
    even = np.ones((96, 96, 3)) * ON_MIRROR
    loss = even - replace(DUST, albedo=0.0).apply(even, CAMERA, CAPTURE_CONTEXT)
    covered = coverage_map(replace(DUST, albedo=0.0), CAMERA, CAPTURE_CONTEXT.noise_seed.camera_key)
    np.testing.assert_allclose(loss, np.repeat(covered, 3, axis=-1), atol=1e-12)


@pytest.mark.parametrize("f_number", [2.0, 4.0, 16.0])
@pytest.mark.parametrize("diameter_m", [5e-5, 2e-4, 5e-4])
def test_fraction_of_the_surface_that_is_covered_is_the_configured_one(
    f_number: float, diameter_m: float
) -> None:
    marks = Contaminants(0.005, diameter_m, 0, 0.02, 5e-5)
    dust = MirrorDust(marks, 0.3, Aperture(f_number, 7.4e-6, 0.0))
    surface_table = mirror_surface_table(PAPER)
    radius = np.hypot(*np.moveaxis(pixel_sample_positions(PAPER)[:, :, 0] - PAPER.centre_px, -1, 0))
    _, radial, tangential = surface_table.interpolate(
        np.interp(radius, surface_table.image_radius_px, surface_table.r_m)
    )
    surface = (radius <= PAPER.rim_radius_px) / (radial * tangential)
    covered = coverage_map(dust, PAPER, (8, 9))[..., 0]
    # Particles overlap by some hundredths of their coverage, and reach over the rim.
    assert (covered * surface).sum() / surface.sum() == pytest.approx(0.005, rel=0.05)


def test_contaminants_when_the_lens_is_open_are_blurred_and_keep_their_light() -> None:
    sharp, soft = (
        coverage_map(MirrorDust(WITHOUT_SCRATCHES, 0.3, lens), PAPER, (1, 2))
        for lens in (PINHOLE, replace(LENS, f_number=2.0))
    )
    assert soft.max() < sharp.max()
    assert np.count_nonzero(soft) > 1.2 * np.count_nonzero(sharp)
    assert soft.sum() == pytest.approx(sharp.sum(), rel=0.02)


def test_contaminants_stay_where_they_are_in_every_exposure_and_differ_between_cameras() -> None:
    image = make_test_pattern(1.0)
    later = replace(
        CAPTURE_CONTEXT, noise_seed=NoiseSeed(CAPTURE_CONTEXT.noise_seed.camera_key, 77)
    )
    other = replace(CAPTURE_CONTEXT, noise_seed=NoiseSeed((1, 1), CAPTURE_CONTEXT.noise_seed.tick))
    now = DUST.apply(image, CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_array_equal(now, DUST.apply(image, CAMERA, later))
    assert np.abs(now - DUST.apply(image, CAMERA, other)).max() > 0.01


GRID = [
    Contaminants(cover, diameter_m, scratches, 0.02, 2e-5)
    for cover in (0.0, 1e-8, 1e-4, 0.02)
    for diameter_m in (2e-5, 2e-4, 2e-3)
    for scratches in (0, 3)
]


LENSES = (LENS, PINHOLE, replace(LENS, f_number=1.4))
# A map of the most and smallest particles takes a second: one lens for each number of scratches.
MANY = {(18, 1), (18, 2), (19, 0), (19, 2)}


@pytest.mark.parametrize(
    ("marks", "lens"),
    quick_cases(
        product(GRID, LENSES),
        *(
            len(LENSES) * marks + lens
            for marks in range(len(GRID))
            for lens in range(len(LENSES))
            if (marks, lens) not in MANY
        ),
    ),
)
def test_maximum_coverage_is_exceeded_by_no_camera(marks: Contaminants, lens: Aperture) -> None:
    dust = MirrorDust(marks, 0.3, lens)
    maximum = max_coverage(dust, CAMERA)
    reached = max(float(coverage_map(dust, CAMERA, (key, 5)).max()) for key in range(4))
    # Strictly: a map that was cut at the maximum would reach it.
    assert reached < maximum or maximum in (0.0, 1.0)
    assert reached <= 1.0


@pytest.mark.parametrize("largest", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("marks", GRID)
def test_bound_when_anything_lies_on_the_mirror_holds(marks: Contaminants, largest: float) -> None:
    for albedo in (0.0, 0.3, 1.0):
        dust = MirrorDust(marks, albedo, LENS)
        bound = dust.bound(SceneSummary(largest), CAMERA).value
        assert max_grey_level_change(dust, make_test_pattern(largest)) <= bound + 1e-6


@pytest.mark.parametrize(
    "dust",
    [
        CLEAN,
        MirrorDust(replace(WITHOUT_SCRATCHES, coverage=1e-9), 0.3, LENS),
        MirrorDust(replace(WITHOUT_SCRATCHES, coverage=3e-9), 1.0, LENS),
        MirrorDust(Contaminants(0.0, 2e-4, 1, 0.02, 1e-7), 0.0, LENS),
    ],
)
def test_mirror_when_nearly_clean_is_disabled(dust: MirrorDust) -> None:
    assert_effect_negligible(dust)


def test_dust_when_the_night_is_dark_is_disabled() -> None:
    assert_effect_negligible(DUST, max_radiance=1e-4)


@pytest.mark.parametrize(
    "marks",
    [
        CONTAMINANTS,
        replace(WITHOUT_SCRATCHES, coverage=1e-5),
        replace(WITHOUT_SCRATCHES, coverage=0.05, mean_particle_diameter_m=2e-5),
        Contaminants(0.0, 2e-4, 3, 0.02, 5e-6),
    ],
)
@pytest.mark.parametrize("albedo", [0.0, 0.3])
def test_mirror_when_dusty_or_scratched_is_enabled(marks: Contaminants, albedo: float) -> None:
    assert_effect_not_negligible(MirrorDust(marks, albedo, LENS))


def test_orthographic_camera_s_mirror_when_dusty_is_enabled() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0, width_px=96)
    assert_effect_not_negligible(DUST, camera=camera)


def test_bound_of_a_known_camera_is_that_of_its_own_map() -> None:
    any_camera = DUST.bound(SceneSummary(1.0), CAMERA)
    for key in ((7, 11), (1, 2), (3, 4)):
        bound = DUST.bound(SceneSummary(1.0, camera_key=key), CAMERA)
        assert 0.0 < bound.value <= any_camera.value
        image = make_test_pattern()
        context = replace(CAPTURE_CONTEXT, noise_seed=NoiseSeed(key))
        change = srgb_from_linear(DUST.apply(image, CAMERA, context)) - srgb_from_linear(image)
        assert 0.2 * bound.value < 255.0 * np.abs(change).max() <= bound.value
