"""Exposure, gains, noise and conversion of a sensor against closed forms, and their criteria."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.effect import CaptureContext, ImageEffect
from catoptra_server.effects.kernels.grey_levels import mean_luminance
from catoptra_server.effects.sensor.auto_exposure import AutoExposure
from catoptra_server.effects.sensor.bayer import Bayer
from catoptra_server.effects.sensor.blooming import Blooming
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.effects.sensor.fixed_pattern import FixedPattern
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.effects.sensor.read_noise import ReadNoise
from catoptra_server.effects.sensor.shot_noise import ShotNoise
from catoptra_server.effects.sensor.white_balance import WhiteBalance
from catoptra_server.world.camera_state import NoiseSeed
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    NOISE_SEED,
    assert_criterion,
    make_test_pattern,
)

AUTO_EXPOSURE = AutoExposure(0.18, 0.1, 10.0)
BLOOMING = Blooming(0.3, 5.0)
LONG_EXPOSURE = Exposure(0.1, 0.02)
PATTERN = FixedPattern(0.02, 9.0, 18000.0)
AMPLIFIER = ReadNoise(13.0, 18000.0)
PHOTONS = ShotNoise(18000.0)
WARM_BALANCE = WhiteBalance(1.6, 0.7)
Case = tuple[ImageEffect, float]


@pytest.mark.parametrize(
    ("off", "on"),
    [
        ([(AutoExposure(0.18, 0.9995, 1.0005), 1.0)], [(AUTO_EXPOSURE, 1.0)]),
        ([(Bayer(), 1e-4)], [(Bayer(), 1.0)]),
        ([(BLOOMING, 1.0)], [(BLOOMING, 3.0)]),
        (
            [(Exposure(0.02, 0.02), 1.0), (Exposure(0.02005, 0.02), 1.0), (LONG_EXPOSURE, 1e-5)],
            [(LONG_EXPOSURE, 1.0), (Exposure(0.005, 0.02), 1.0)],
        ),
        ([(FixedPattern(1e-4, 0.1, 18000.0), 1.0)], [(PATTERN, 1.0)]),
        ([(Quantisation(12), 1.0)], [(Quantisation(8), 1.0)]),
        ([(ReadNoise(0.4, 18000.0), 1.0)], [(AMPLIFIER, 1.0)]),
        ([(ShotNoise(1e8), 1.0)], [(PHOTONS, 1.0)]),
        (
            [(WhiteBalance(1.002, 0.999), 1.0), (WhiteBalance(1.0, 1.0), 5.0)],
            [(WARM_BALANCE, 1.0), (WhiteBalance(1.0, 1.01), 1.0)],
        ),
    ],
    ids=lambda cases: type(cases[0][0]).__name__,
)
def test_criterion_enables_what_shows_and_leaves_out_what_does_not(
    off: list[Case], on: list[Case]
) -> None:
    assert_criterion(off=off, on=on)


def apply(effect: ImageEffect, image: Floats) -> Floats:
    return effect.apply(image, CAMERA, CAPTURE_CONTEXT)


def measure_flat_field(effect: ImageEffect, level: float, seed: NoiseSeed = NOISE_SEED) -> Floats:
    """(200, 200, 3) image of an even light: 120 000 numbers."""
    return effect.apply(np.full((200, 200, 3), level), CAMERA, CaptureContext(seed))


def correlation(one: Floats, other: Floats) -> float:
    return abs(float(np.corrcoef(one.ravel(), other.ravel())[0, 1]))


@pytest.mark.parametrize("largest", [0.1, 1.0, 5.0])
def test_mean_when_the_automatic_gain_suffices_is_the_target(largest: float) -> None:
    behind = apply(AUTO_EXPOSURE, make_test_pattern(largest))
    assert mean_luminance(behind, CAMERA) == pytest.approx(0.18, rel=1e-12)


@pytest.mark.parametrize(("largest", "gain"), [(1e-3, 10.0), (100.0, 0.1), (0.0, 10.0)])
def test_automatic_gain_when_the_target_is_out_of_reach_stays_at_its_limit(
    largest: float, gain: float
) -> None:
    assert AUTO_EXPOSURE.gain(mean_luminance(make_test_pattern(largest), CAMERA)) == gain


@pytest.mark.parametrize("shape", [(6, 8, 3), (5, 7, 3)])
def test_even_light_behind_a_colour_filter_stays_what_it_is(shape: tuple[int, ...]) -> None:
    light = np.broadcast_to([0.2, 0.5, 0.7], shape).copy()
    np.testing.assert_allclose(apply(Bayer(), light), light, rtol=1e-15)


def test_ramp_when_interpolated_is_exact_inside() -> None:
    rows, columns = np.mgrid[:9, :9]
    light = np.stack([0.1 * rows + 0.02 * columns + c for c in (0.0, 0.3, 0.5)], axis=-1)
    found = apply(Bayer(), light)
    np.testing.assert_allclose(found[1:-1, 1:-1], light[1:-1, 1:-1], rtol=1e-12)


def test_border_when_interpolated_is_mirrored_about_the_last_pixel() -> None:
    light = np.zeros((4, 4, 3))
    light[1, 0, 1] = 1.0  # a green filter, below a red one in the corner
    assert apply(Bayer(), light)[0, 0, 1] == pytest.approx(0.5)


@pytest.mark.parametrize(("row", "column", "channel"), [(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)])
def test_colour_of_the_filters_red_green_green_blue_is_kept_and_alone_counts(
    row: int, column: int, channel: int
) -> None:
    light = make_test_pattern()
    own = np.zeros_like(light)
    own[row::2, column::2, channel] = light[row::2, column::2, channel]
    kept = apply(Bayer(), light)[row::2, column::2, channel]
    np.testing.assert_array_equal(kept, light[row::2, column::2, channel])
    np.testing.assert_array_equal(kept, apply(Bayer(), own)[row::2, column::2, channel])


def bloom_row(row: int) -> Floats:
    image = np.zeros((20, 7, 3))
    image[row, 3] = (4.0, 1.0, 0.5)
    return apply(BLOOMING, image)


def test_charge_when_it_overflows_is_the_fraction_of_the_excess_in_its_column_and_colour() -> None:
    behind = bloom_row(10)
    red = behind[..., 0]
    assert (red - np.where(red >= 4.0, 4.0, 0.0)).sum() == pytest.approx(0.3 * 3.0)
    assert set(np.flatnonzero(red.any(axis=0))) == {3}
    assert list(np.flatnonzero(red[:, 3])) == list(range(5, 16))
    assert behind[9, 3, 1] == behind[9, 3, 2] == 0.0


def test_charge_when_it_leaves_the_image_is_lost() -> None:
    assert bloom_row(0)[1:, 3, 0].sum() == pytest.approx(0.5 * 0.3 * 3.0)


def test_image_below_the_full_well_keeps_every_bit() -> None:
    image = np.random.default_rng(1).uniform(0.0, 1.0, (20, 7, 3))
    np.testing.assert_array_equal(apply(BLOOMING, image), image)


def test_light_when_the_shutter_is_open_longer_grows_with_the_time() -> None:
    light = make_test_pattern()
    np.testing.assert_allclose(apply(LONG_EXPOSURE, light), 5.0 * light, rtol=1e-15)


def test_pixels_differ_by_the_dark_signal_and_where_lit_by_their_gain() -> None:
    # A standard deviation is known to 0.2 %.
    dark, dim, bright = (measure_flat_field(PATTERN, level) for level in (0.0, 0.3, 0.8))
    assert dark.std() * 18000.0 == pytest.approx(9.0, rel=0.01)
    assert (bright - dim).std() == pytest.approx(0.02 * 0.5, rel=0.01)


def test_pattern_stays_in_every_frame_and_is_another_one_of_another_camera() -> None:
    mine = measure_flat_field(PATTERN, 0.5)
    later = measure_flat_field(PATTERN, 0.5, NoiseSeed(NOISE_SEED.camera_key, 99))
    np.testing.assert_array_equal(mine, later)
    other = measure_flat_field(PATTERN, 0.5, NoiseSeed((8, 11), NOISE_SEED.tick))
    assert correlation(mine, other) < 0.02


def test_light_when_converted_is_a_whole_code_at_most_half_a_step_away() -> None:
    image = np.linspace(-0.05, 1.0, 3000).reshape(10, 100, 3)
    codes = 1023.0 * apply(Quantisation(10), image)
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-9)
    assert np.abs(codes - 1023.0 * image).max() <= 0.5 + 1e-9


def test_error_of_a_converter_has_the_variance_of_a_twelfth() -> None:
    image = np.random.default_rng(2).uniform(0.0, 1.0, (200, 200, 3))
    error = 255.0 * (apply(Quantisation(8), image) - image)
    assert error.var() == pytest.approx(1.0 / 12.0, rel=0.02)


def test_light_beyond_white_is_white_behind_a_converter() -> None:
    assert apply(Quantisation(8), np.full((2, 2, 3), 7.0)).max() == 1.0


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0])
def test_spread_in_electrons_is_the_amplifiers_whatever_the_light(level: float) -> None:
    electrons = 18000.0 * (measure_flat_field(AMPLIFIER, level) - level)
    assert electrons.std() == pytest.approx(13, rel=0.01)


@pytest.mark.parametrize("level", [0.001, 0.05, 0.5, 0.9])
def test_variance_in_electrons_of_photons_is_their_number(level: float) -> None:
    electrons = 18000.0 * measure_flat_field(PHOTONS, level)
    # A variance is known to 0.4 %, a mean to 0.3 % of a standard deviation.
    assert electrons.var() == pytest.approx(18000.0 * level, rel=0.02)
    assert electrons.mean() == pytest.approx(18000.0 * level, abs=0.02 * electrons.std())


def test_noise_is_the_same_in_a_frame_drawn_twice_and_independent_in_the_next() -> None:
    first, again = (measure_flat_field(PHOTONS, 0.5) for _ in range(2))
    assert first.tobytes() == again.tobytes()
    following = NoiseSeed(NOISE_SEED.camera_key, NOISE_SEED.tick + 1)
    assert correlation(first, measure_flat_field(PHOTONS, 0.5, following)) < 0.02


def test_well_when_full_is_not_exceeded_and_the_dark_is_noiseless() -> None:
    full = measure_flat_field(PHOTONS, 3.0)
    assert full.min() == full.max() == 1.0
    assert not measure_flat_field(PHOTONS, 0.0).any()


# White clipped before takes on the gains.
@pytest.mark.parametrize(("level", "expected"), [(0.5, (0.8, 0.5, 0.35)), (40.0, (1.6, 1.0, 0.7))])
def test_colours_when_balanced_are_amplified_against_green(
    level: float, expected: tuple[float, float, float]
) -> None:
    behind = apply(WARM_BALANCE, np.full((1, 1, 3), level))
    np.testing.assert_allclose(behind[0, 0], expected, rtol=1e-15)
