"""Bounds of changes by search, the hash in plain integers, variates by their distribution."""

from __future__ import annotations

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects import EffectChange, SceneSummary
from catoptra_server.effects.kernels.grey_levels import (
    MAX_NORMAL_VARIATE,
    camera_noise_key,
    count_valid_pixels,
    find_changes,
    frame_noise_key,
    grey_level,
    max_change_by_exchange,
    max_change_by_gain,
    max_change_by_offset,
    max_change_by_shift,
    mean_luminance,
    measure_change,
    normal_quantile_table,
    normal_variates,
    pcg3d,
    valid_pixels,
)
from catoptra_server.world.objects import NoiseSeed
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import CAMERA, NOISE_SEED, make_test_pattern

LIGHT = np.concatenate((np.geomspace(1e-6, 20.0, 40001), [1.0]))


@pytest.mark.parametrize("gain", [0.0, 0.01, 0.5, 0.95, 0.9999, 1.0, 1.0001, 1.1, 3.0, 100.0])
@pytest.mark.parametrize("max_radiance", [1e-4, 0.02, 0.5, 1.0, 20.0])
def test_change_by_gain_is_the_largest_of_all_greys(gain: float, max_radiance: float) -> None:
    radiance = np.append(LIGHT[LIGHT <= max_radiance], max_radiance)
    changes = 255.0 * np.abs(srgb_from_linear(gain * radiance) - srgb_from_linear(radiance))
    assert changes.max() == pytest.approx(
        max_change_by_gain(gain, max_radiance), rel=2e-3, abs=2e-3
    )


@pytest.mark.parametrize("gain", [0.1, 1.0, 1000.0])
@pytest.mark.parametrize("max_radiance", [1e-4, 0.02, 1.0, 20.0])
def test_change_by_offset_is_the_largest_of_all_greys(max_radiance: float, gain: float) -> None:
    radiance = np.append(LIGHT[LIGHT <= max_radiance], max_radiance)
    summary = SceneSummary(max_radiance, gains=(gain, gain))
    bound = max_change_by_offset(lambda x: np.full_like(x, 0.003), summary)
    for offset in (0.003, -0.003):
        before, after = (
            srgb_from_linear(gain * radiance),
            srgb_from_linear(gain * (radiance + offset)),
        )
        assert 255.0 * np.abs(after - before).max() <= bound + 1e-3


@pytest.mark.parametrize("gains", [(1.0, 1.0), (0.0, 1.0), (0.1, 10.0), (5.0, 1000.0)])
def test_change_of_the_picture_is_the_largest_by_any_gain(gains: tuple[float, float]) -> None:
    one = np.array((0.0, 1e-6, 1e-4, 0.02, 0.3, 0.9, 1.0, 3.0))[:, None]
    other = np.array((0.0, 2e-6, 1e-3, 0.02, 0.5, 1.5, 40.0))
    all_gains = np.linspace(*gains, 200_001)[:, None, None]
    levels = srgb_from_linear(all_gains * one) - srgb_from_linear(all_gains * other)
    expected = 255.0 * np.abs(levels).max(axis=0)
    found = find_changes(*np.broadcast_arrays(one, other), gains)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-3)
    assert (found >= expected - 1e-9).all()


def test_change_is_in_encoded_levels_of_the_pixel_that_changes_most() -> None:
    before = np.full((2, 2, 3), 0.5, dtype=np.float32)
    after = before.copy()
    after[1, 0, 2] = 1.0
    # sRGB of 0.5 is 187.5 of 255.
    assert measure_change(before, after).largest == pytest.approx(255.0 - 187.52, abs=0.01)
    assert measure_change(before, before) == EffectChange(0.0, 0.0)
    # One pixel of four, however many of its colours change.
    assert measure_change(before, after).visible_share == 0.25
    assert measure_change(before, after + np.float32(0.5)).visible_share == 1.0


@pytest.mark.parametrize("max_radiance", [1e-4, 0.02, 1.0, 20.0])
def test_change_by_exchange_is_the_largest_of_all_greys(max_radiance: float) -> None:
    radiance = np.append(LIGHT[LIGHT <= max_radiance], max_radiance)[::400]
    own, others = np.meshgrid(np.append(0.0, radiance), np.append(max_radiance, radiance))
    for fraction in (0.0, 1e-3, 0.1, 1.0):
        mixed = (1.0 - fraction) * own + fraction * others
        changes = 255.0 * np.abs(srgb_from_linear(mixed) - srgb_from_linear(own))
        bound = max_change_by_exchange(fraction, max_radiance)
        assert changes.max() == pytest.approx(bound, rel=1e-9, abs=1e-9)


def test_change_by_shift_is_that_of_the_area_that_squares_do_not_share() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    for shift_px in (1e-3, 0.1, 0.5, 0.7, 3.0):
        dx, dy = (np.minimum(np.abs(shift_px * part(angle)), 1.0) for part in (np.cos, np.sin))
        exchanged = (1.0 - (1.0 - dx) * (1.0 - dy)).max()
        change = max_change_by_shift(shift_px, 1.0)
        assert max_change_by_exchange(exchanged, 1.0) <= change
        assert change <= 1.2 * max_change_by_exchange(exchanged, 1.0)


def test_grey_level_is_the_curves() -> None:
    assert grey_level(1.0) == pytest.approx(255.0)
    assert grey_level(0.0) == 0.0


ON_MIRROR = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA))[1]


def test_mean_of_an_even_image_counts_only_the_mirror() -> None:
    even = np.full((96, 96, 3), 0.3) * ON_MIRROR
    assert mean_luminance(even, CAMERA) == pytest.approx(0.3, rel=1e-12)


@pytest.mark.parametrize(("channel", "weight"), [(0, 0.2126), (1, 0.7152), (2, 0.0722)])
def test_mean_of_one_colour_has_the_weight_of_rec_709(channel: int, weight: float) -> None:
    image = np.zeros((96, 96, 3))
    image[..., channel] = ON_MIRROR[..., 0]
    assert mean_luminance(image, CAMERA) == pytest.approx(weight, rel=1e-12)


def test_count_when_the_image_is_lit_everywhere_covers_all_lit_pixels() -> None:
    lit = make_test_pattern().any(axis=-1)
    assert lit.sum() <= count_valid_pixels(CAMERA)


@pytest.mark.parametrize(
    "camera", [replace(CAMERA, centre_px=(40.3, 51.0)), PerspectiveCamera(20, 10, 1.0)]
)
def test_valid_pixels_are_those_whose_centre_has_a_direction(camera: RadialCamera) -> None:
    expected = camera.direction_from_pixel(pixel_sample_positions(camera))[1][..., 0]
    np.testing.assert_array_equal(valid_pixels(camera), expected)


def test_mean_of_a_float32_image_is_that_of_float64() -> None:
    single = mean_luminance(make_test_pattern().astype(np.float32), CAMERA)
    assert single == pytest.approx(mean_luminance(make_test_pattern(), CAMERA), rel=1e-6)


NOISE_KEY = frame_noise_key(NOISE_SEED, "test")
VARIATES = normal_variates(NOISE_KEY, 400, 500)


def reference_pcg3d(x: int, y: int, z: int) -> tuple[int, int, int]:
    """Jarzynski and Olano's pcg3d, in unbounded integers."""
    mask = 0xFFFFFFFF
    x, y, z = ((word * 1664525 + 1013904223) & mask for word in (x, y, z))
    for turn in range(2):
        x = (x + y * z) & mask
        y = (y + z * x) & mask
        z = (z + x * y) & mask
        if not turn:
            x, y, z = x ^ x >> 16, y ^ y >> 16, z ^ z >> 16
    return x, y, z


@pytest.mark.parametrize("words", [(0, 0, 0), (1, 2, 3), (0xFFFFFFFF, 0x80000000, 12345)])
def test_hash_is_the_published_one(words: tuple[int, int, int]) -> None:
    arrays = [np.array([word], dtype=np.uint32) for word in words]
    assert tuple(int(word[0]) for word in pcg3d(*arrays)) == reference_pcg3d(*words)


def test_normal_variates_have_the_moments_of_the_normal_distribution() -> None:
    # 600 000 variates: each tolerance is some five standard deviations.
    assert VARIATES.mean() == pytest.approx(0.0, abs=0.007)
    assert VARIATES.var() == pytest.approx(1.0, abs=0.01)
    assert (VARIATES**3).mean() == pytest.approx(0.0, abs=0.03)
    assert (VARIATES**4).mean() == pytest.approx(3.0, abs=0.07)


@pytest.mark.parametrize(
    ("sigma", "fraction"), [(1.0, 0.158655), (2.0, 0.022750), (3.0, 0.0013499)]
)
def test_normal_variates_have_the_tails_of_the_normal_distribution(
    sigma: float, fraction: float
) -> None:
    tolerance = 5.0 * np.sqrt(fraction / VARIATES.size)
    assert (VARIATES > sigma).mean() == pytest.approx(fraction, abs=tolerance)
    assert (VARIATES < -sigma).mean() == pytest.approx(fraction, abs=tolerance)


def test_largest_normal_is_that_of_the_table() -> None:
    largest = 2.0 * float(normal_quantile_table()[-1]) * np.sqrt(0.5)
    assert MAX_NORMAL_VARIATE - 0.01 < largest <= MAX_NORMAL_VARIATE


@pytest.mark.parametrize("step", [(0, 1), (1, 0), (1, 1), (7, 0)])
def test_neighbours_are_independent(step: tuple[int, int]) -> None:
    down, across = step
    other = VARIATES[down:, across:]
    own = VARIATES[: VARIATES.shape[0] - down, : VARIATES.shape[1] - across]
    assert abs(np.corrcoef(own.ravel(), other.ravel())[0, 1]) < 0.007


def test_colours_of_a_pixel_are_independent() -> None:
    correlation = np.corrcoef(VARIATES.reshape(-1, 3).T) - np.eye(3)
    assert np.abs(correlation).max() < 0.012


def test_part_of_an_image_has_the_numbers_of_the_whole() -> None:
    np.testing.assert_array_equal(normal_variates(NOISE_KEY, 50, 60), VARIATES[:50, :60])


def test_keys_differ_by_camera_purpose_and_frame_but_a_cameras_own_stay() -> None:
    keys = [NOISE_SEED, NoiseSeed((8, 11), 3), NoiseSeed((7, 12), 3), NoiseSeed((7, 11), 4)]
    words = {tuple(frame_noise_key(key, what)) for key in keys for what in ("shot", "read")}
    assert len(words) == 8
    np.testing.assert_array_equal(
        camera_noise_key(keys[0], "gain"), camera_noise_key(keys[3], "gain")
    )


def test_quantile_table_does_not_depend_on_the_last_bits_of_a_library_s_logarithms() -> None:
    count = 2**16
    quantile = NormalDist().inv_cdf
    upper = np.array([quantile((index + 0.5) / count) for index in range(count // 2, count)])
    scaled = upper / np.concatenate((-upper, upper)).std()
    table = normal_quantile_table()[count // 2 :]
    for error in (-3e-14, 3e-14):
        np.testing.assert_array_equal(((1.0 + error) * scaled).astype(np.float32), table)
