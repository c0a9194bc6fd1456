"""The hash against the published form in plain integers, variates against their distribution."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.kernels.light import (
    MAX_NORMAL_VARIATE,
    camera_noise_key,
    frame_noise_key,
    normal_quantile_table,
    normal_variates,
    pcg3d,
)
from catoptra_server.world.camera_state import NoiseSeed
from helpers.effect_measurement import NOISE_SEED

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
