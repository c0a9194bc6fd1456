from __future__ import annotations

import math

import numpy as np

from catoptra_server.world.camera_state import FogMedium

FOG = FogMedium(0.5, (0.6, 0.5, 0.4))


def test_light_of_a_black_surface_is_the_airlight_before_it() -> None:
    mixed = FOG.mix(np.zeros((1, 3)), np.array([2.0]))
    np.testing.assert_allclose(mixed, (1.0 - math.exp(-1.0)) * np.array([FOG.airlight]))


def test_light_without_a_distance_is_the_surfaces_and_at_infinity_the_airlight() -> None:
    mixed = FOG.mix(np.ones((2, 3)), np.array([0.0, np.inf]))
    np.testing.assert_array_equal(mixed, [(1.0, 1.0, 1.0), FOG.airlight])


def test_white_and_black_at_the_visual_range_differ_by_5_percent() -> None:
    # Koschmieder: the visibility is ln(20) / beta.
    range_m = np.array(math.log(20.0) / FOG.density_per_m)
    contrast = FOG.mix(np.ones(3), range_m) - FOG.mix(np.zeros(3), range_m)
    np.testing.assert_allclose(contrast, 0.05, rtol=1e-12)


def test_transmittance_of_any_fog_is_1_at_no_distance_and_0_at_infinity() -> None:
    ranges = np.array([0.0, 2.0, 1e6, np.inf])
    np.testing.assert_allclose(FOG.transmittance(ranges), [1.0, math.exp(-1.0), 0.0, 0.0])
