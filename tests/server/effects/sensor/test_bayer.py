from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.effects.sensor.bayer import Bayer
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion, make_test_pattern


def demosaic(image: np.ndarray) -> np.ndarray:
    return Bayer().apply(image, CAMERA, CAPTURE_CONTEXT)


@pytest.mark.parametrize("shape", [(6, 8, 3), (5, 7, 3)])
def test_light_when_it_is_the_same_everywhere_stays_what_it_is(shape: tuple[int, ...]) -> None:
    light = np.broadcast_to([0.2, 0.5, 0.7], shape).copy()
    np.testing.assert_allclose(demosaic(light), light, rtol=1e-15)


def test_ramp_when_interpolated_is_exact_inside() -> None:
    rows, columns = np.mgrid[:9, :9]
    light = np.stack([0.05 * rows + 0.01 * columns + c for c in (0.0, 0.3, 0.5)], axis=-1)
    np.testing.assert_allclose(demosaic(light)[1:-1, 1:-1], light[1:-1, 1:-1], rtol=1e-12)


def test_light_above_the_full_well_is_measured_as_a_full_well() -> None:
    light = np.zeros((6, 6, 3))
    light[2, 3, 1] = 40.0  # a green filter, beside red ones
    assert demosaic(light).max() == 1.0
    assert demosaic(light)[2, 2, 1] == 0.25


@pytest.mark.parametrize("size", [0.003, 0.1, 0.5, 2.0])
def test_mosaic_shows_no_change_of_light_more_than_its_gains_do(size: float) -> None:
    generator = np.random.default_rng(3)
    one = generator.uniform(0.0, 2.0, (48, 64, 3)) ** 4
    other = one * generator.uniform(1.0, 1.0 + size, one.shape)
    pictures = [255.0 * srgb_from_linear(demosaic(light)) for light in (one, other)]
    shown = float(np.abs(pictures[1] - pictures[0]).max())
    assert shown <= find_changes(one, other, Bayer().gains).max() + 1e-9


def test_light_above_the_full_well_is_white_whatever_it_loses() -> None:
    light = np.full((6, 6, 3), 1.8)
    assert find_changes(light, light / 1.8, Bayer().gains).max() == 0.0


def test_border_when_interpolated_is_mirrored_about_the_last_pixel() -> None:
    light = np.zeros((4, 4, 3))
    light[1, 0, 1] = 1.0  # a green filter, below a red one in the corner
    assert demosaic(light)[0, 0, 1] == pytest.approx(0.5)


@pytest.mark.parametrize(("row", "column", "channel"), [(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)])
def test_colour_of_the_filters_red_green_green_blue_is_kept_and_alone_counts(
    row: int, column: int, channel: int
) -> None:
    light = make_test_pattern()
    own = np.zeros_like(light)
    own[row::2, column::2, channel] = light[row::2, column::2, channel]
    kept = demosaic(light)[row::2, column::2, channel]
    np.testing.assert_array_equal(kept, light[row::2, column::2, channel])
    np.testing.assert_array_equal(kept, demosaic(own)[row::2, column::2, channel])


def test_criterion_enables_the_day_and_not_the_night() -> None:
    assert_criterion(off=[(Bayer(), 1e-4)], on=[(Bayer(), 1.0)])
