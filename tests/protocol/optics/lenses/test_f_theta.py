"""f-theta lens: the angle as a polynomial of the radius."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import FThetaLens
from helpers.lens_checks import assert_is_projection, assert_rejects, theta_deg_from_radius


@pytest.mark.parametrize("lens", [FThetaLens(0.003), FThetaLens(0.003, 1e-7, -1e-10)])
def test_lens_is_a_projection(lens: FThetaLens) -> None:
    assert_is_projection(lens, to_rad=math.radians(170.0))
    assert_rejects(lens)


def test_lens_ends_where_the_angle_stops_growing() -> None:
    # theta = r / 100 - r^2 / 40000: slope 0 at r = 200, where theta is 1.
    lens = FThetaLens(0.01, -0.25e-4)
    assert lens.fold_rad == pytest.approx(1.0)
    assert math.isinf(theta_deg_from_radius(lens, 200.1))
    with pytest.raises(DomainError, match="limit"):
        lens.radius_ratio_from_t(np.array(math.tan(0.51)))


def test_lens_that_reaches_the_antipode_has_no_fold() -> None:
    assert math.isinf(FThetaLens(0.01).fold_rad)
    assert theta_deg_from_radius(FThetaLens(0.01), 100.0 * math.pi) == pytest.approx(180.0)
