from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.world.camera_state import INSTANTANEOUS, MAX_TIME_SAMPLES, Shutter

ROWS = 10


@pytest.mark.parametrize(
    "shutter",
    [Shutter(0.04, 0.0, 5), Shutter(0.0, 0.03, 7), Shutter(0.02, 0.05, 8), Shutter(0.01, 0.0, 1.2)],
)
def test_weights_of_a_row_sum_to_one_with_the_mean_at_the_time_of_the_row(shutter: Shutter) -> None:
    weights = shutter.row_weights(ROWS)
    assert weights.shape == (shutter.num_time_samples, ROWS)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, rtol=1e-6)
    centre_s = shutter.readout_s * ((np.arange(ROWS) + 0.5) / ROWS - 0.5)
    slot_s = (shutter.exposure_s + shutter.readout_s) / shutter.num_time_samples
    mean_s = np.asarray(shutter.times_s) @ weights
    assert np.abs(mean_s - centre_s).max() <= 0.5 * slot_s + 1e-9


def test_global_shutter_weights_all_time_samples_equally() -> None:
    np.testing.assert_allclose(Shutter(0.04, 0.0, 4).row_weights(3), 0.25)
    assert Shutter(0.04, 0.0, 4).times_s == pytest.approx((-0.015, -0.005, 0.005, 0.015))


def test_rows_without_an_exposure_have_one_time_sample_each_in_order() -> None:
    weights = Shutter(0.0, 0.02, 4).row_weights(8)
    assert weights.argmax(axis=0).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize(
    ("exposure_px", "readout_px", "time_samples"),
    [
        (0.2, 0.0, 2),
        (1.0, 0.0, 2),
        (3.2, 0.0, 4),
        (0.0, 3.2, 13),
        (2.0, 1.0, 6),
        (1e4, 0.0, MAX_TIME_SAMPLES),
        (math.inf, 0.0, MAX_TIME_SAMPLES),
    ],
)
def test_time_samples_when_chosen_are_a_pixel_apart_and_a_quarter_for_rows(
    exposure_px: float, readout_px: float, time_samples: int
) -> None:
    shutter = INSTANTANEOUS.with_readout(0.0, readout_px).with_exposure(0.01, exposure_px)
    assert shutter.num_time_samples == time_samples


@pytest.mark.parametrize(("limit", "time_samples"), [(10, 10), (64, 33), (3, 3), (0, 2)])
def test_time_samples_are_limited_but_never_fewer_than_two(limit: int, time_samples: int) -> None:
    shutter = Shutter(0.01, 0.0, 33.0, max_time_samples=limit)
    assert shutter.num_time_samples == len(shutter.times_s) == time_samples
    np.testing.assert_allclose(shutter.row_weights(3).sum(axis=0), 1.0, rtol=1e-6)
