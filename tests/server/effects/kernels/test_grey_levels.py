from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.kernels.grey_levels import (
    grey_level,
    max_change_by_gain,
    max_change_by_offset,
)
from catoptra_server.scene.colour import srgb_from_linear

LIGHT = np.concatenate((np.geomspace(1e-6, 20.0, 40001), [1.0]))


@pytest.mark.parametrize("gain", [0.0, 0.01, 0.5, 0.95, 0.9999, 1.0, 1.0001, 1.1, 3.0, 100.0])
@pytest.mark.parametrize("largest", [1e-4, 0.02, 0.5, 1.0, 20.0])
def test_change_by_gain_is_the_largest_of_all_greys(gain: float, largest: float) -> None:
    light = np.append(LIGHT[LIGHT <= largest], largest)
    changes = 255.0 * np.abs(srgb_from_linear(gain * light) - srgb_from_linear(light))
    assert changes.max() == pytest.approx(max_change_by_gain(gain, largest), rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("largest", [1e-4, 0.02, 1.0, 20.0])
def test_change_by_offset_is_the_largest_of_all_greys(largest: float) -> None:
    light = np.append(LIGHT[LIGHT <= largest], largest)
    for offset in (0.003, -0.003):
        changes = 255.0 * np.abs(srgb_from_linear(light + offset) - srgb_from_linear(light))
        assert (
            changes.max() <= max_change_by_offset(lambda x: np.full_like(x, 0.003), largest) + 1e-3
        )


def test_grey_level_is_the_curves() -> None:
    assert grey_level(1.0) == pytest.approx(255.0)
    assert grey_level(0.0) == 0.0
