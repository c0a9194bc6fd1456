"""Kannala-Brandt lens: published calibrations, fold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import DoubleSphereLens, KannalaBrandtLens
from catoptra_protocol.optics.omni_camera import OmniCamera
from helpers.lens_checks import assert_is_projection, assert_rejects, limit_rad, radii

TUM_VI = KannalaBrandtLens(0.00348239, 0.00071503, -0.00205324, 0.00020294)
LUMIX = KannalaBrandtLens(-0.030687, -0.003343, -0.002882, -0.000592)


@pytest.mark.parametrize("lens", [TUM_VI, LUMIX, KannalaBrandtLens()])
def test_published_lens_is_a_projection_up_to_its_limit(lens: KannalaBrandtLens) -> None:
    assert_is_projection(lens, to_rad=0.995 * limit_rad(lens))
    assert_rejects(lens)


def test_lens_ends_where_its_polynomial_turns_back() -> None:
    fold_deg = math.degrees(LUMIX.fold_rad)
    assert fold_deg == pytest.approx(93.279, abs=1e-3)
    before, at_fold = radii(LUMIX, fold_deg - 1e-3, fold_deg)
    assert before < at_fold
    with pytest.raises(DomainError, match="limit"):
        radii(LUMIX, fold_deg + 1e-3)
    with pytest.raises(DomainError, match=r"93\.279 deg, where its image radius turns back"):
        OmniCamera(LUMIX, 960, 540, (480.0, 270.0), 441.7, math.radians(94.0))


def test_two_published_models_of_one_lens_differ_by_less_than_a_pixel() -> None:
    # The first camera of TUM-VI by Kannala-Brandt and by a double sphere.
    other = DoubleSphereLens(-0.17213, 0.59312)
    difference = 190.978 * radii(TUM_VI, 50.0, 90.0) - 158.286 * radii(other, 50.0, 90.0)
    assert np.abs(difference) == pytest.approx((0.27, 0.76), abs=0.03)
