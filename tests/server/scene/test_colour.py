"""sRGB against the numbers of IEC 61966-2-1."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.world.world_description import linear_from_srgb, srgb_from_linear


@pytest.mark.parametrize(
    ("encoded", "linear"),
    [(0.0, 0.0), (0.04045, 0.0031308), (0.5, 0.21404), (0.735357, 0.5), (1.0, 1.0)],
)
def test_decoded_values_are_the_standards(encoded: float, linear: float) -> None:
    # The standard gives five digits.
    assert linear_from_srgb(np.array(encoded)) == pytest.approx(linear, abs=6e-6)


def test_256_levels_survive_decoding_and_encoding() -> None:
    levels = np.arange(256) / 255.0
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(levels)), levels, atol=1e-7)


def test_curve_is_continuous_and_rises_at_its_joint() -> None:
    around = np.linspace(0.003, 0.0033, 301)
    steps = np.diff(srgb_from_linear(around))
    assert (steps > 0.0).all()
    # The two pieces meet to 1e-7 only, as the standard's rounded constants have it.
    assert steps.max() < 1.3e-5


def test_light_out_of_range_is_clipped() -> None:
    clipped = srgb_from_linear(np.array([-1.0, 2.0, 1e300]))
    np.testing.assert_allclose(clipped, [0.0, 1.0, 1.0], rtol=1e-15)
