from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.kernels.light import (
    grey_level,
    max_change_by_exchange,
    max_change_by_gain,
    max_change_by_offset,
    max_change_by_shift,
)
from catoptra_server.world.world_description import srgb_from_linear

LIGHT = np.concatenate((np.geomspace(1e-6, 20.0, 40001), [1.0]))


@pytest.mark.parametrize("gain", [0.0, 0.01, 0.5, 0.95, 0.9999, 1.0, 1.0001, 1.1, 3.0, 100.0])
@pytest.mark.parametrize("max_radiance", [1e-4, 0.02, 0.5, 1.0, 20.0])
def test_change_by_gain_is_the_largest_of_all_greys(gain: float, max_radiance: float) -> None:
    radiance = np.append(LIGHT[LIGHT <= max_radiance], max_radiance)
    changes = 255.0 * np.abs(srgb_from_linear(gain * radiance) - srgb_from_linear(radiance))
    assert changes.max() == pytest.approx(
        max_change_by_gain(gain, max_radiance), rel=2e-3, abs=2e-3
    )


@pytest.mark.parametrize("max_radiance", [1e-4, 0.02, 1.0, 20.0])
def test_change_by_offset_is_the_largest_of_all_greys(max_radiance: float) -> None:
    radiance = np.append(LIGHT[LIGHT <= max_radiance], max_radiance)
    for offset in (0.003, -0.003):
        changes = 255.0 * np.abs(srgb_from_linear(radiance + offset) - srgb_from_linear(radiance))
        assert (
            changes.max()
            <= max_change_by_offset(lambda x: np.full_like(x, 0.003), max_radiance) + 1e-3
        )


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
