from __future__ import annotations

import math

import numpy as np

from catoptra_server.effects.kernels.lens_blur import CircleOfConfusion

CIRCLE = CircleOfConfusion(np.array(-2.0), np.array(3.0), np.array(1.0), np.array(0.5))


def test_disc_shrinks_to_a_point_at_the_focus_and_grows_behind() -> None:
    # -2 + 3 / (D + 1/2) vanishes at D = 1.
    assert CIRCLE.diameter_px(np.array([0.5, 1.0, math.inf])).tolist() == [1.0, 0.0, 2.0]


def test_near_term_of_an_object_in_the_mirror_is_finite() -> None:
    assert np.isfinite(CIRCLE.near_term_px(np.array(-0.5)))
