from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.sensor.blooming import Blooming
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion

BLOOMING = Blooming(0.3, 5.0)


def bloom_row(row: int) -> np.ndarray[tuple[int, int, int]]:
    image = np.zeros((20, 7, 3))
    image[row, 3] = (4.0, 1.0, 0.5)
    return BLOOMING.apply(image, CAMERA, CAPTURE_CONTEXT)


def test_charge_when_it_overflows_is_the_fraction_of_the_excess_charge() -> None:
    overflow = bloom_row(10) - np.where(bloom_row(10) >= 4.0, 4.0, 0.0)
    assert overflow[..., 0].sum() == pytest.approx(0.3 * 3.0)


def test_charge_when_it_overflows_stays_in_its_column_and_colour() -> None:
    red = bloom_row(10)[..., 0]
    assert set(np.flatnonzero(red.any(axis=0))) == {3}
    assert list(np.flatnonzero(red[:, 3])) == list(range(5, 16))
    assert bloom_row(10)[9, 3, 1] == bloom_row(10)[9, 3, 2] == 0.0


def test_charge_when_it_leaves_the_image_is_lost() -> None:
    assert bloom_row(0)[1:, 3, 0].sum() == pytest.approx(0.5 * 0.3 * 3.0)


def test_image_below_the_full_well_keeps_every_bit() -> None:
    image = np.random.default_rng(1).uniform(0.0, 1.0, (20, 7, 3))
    np.testing.assert_array_equal(BLOOMING.apply(image, CAMERA, CAPTURE_CONTEXT), image)


def test_criterion_enables_a_bright_scene_alone() -> None:
    assert_criterion(off=[(BLOOMING, 1.0)], on=[(BLOOMING, 3.0)])
