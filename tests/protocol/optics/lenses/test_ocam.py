"""OCamCalib's lens: the published calibration, the parabola, the first fold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import OCamLens
from helpers.lens_checks import assert_is_projection, assert_rejects, radii, theta_deg_from_radius

LAFIDA = OCamLens((209.2008, 0.0, -0.00213742, 4.22036e-6, -1.771461e-8))


def test_published_lens_is_a_projection() -> None:
    assert_is_projection(LAFIDA, to_rad=math.radians(120.0))
    assert_rejects(LAFIDA, LAFIDA.t_limit * 1.01)


def test_parabola_has_two_terms() -> None:
    # z = (h^2 - r^2) / (2 h): a0 = h / 2, a2 = -1 / (2 h).
    lens, theta = OCamLens((50.0, 0.0, -0.005)), (10.0, 90.0, 120.0)
    assert radii(lens, *theta) == pytest.approx(100.0 * np.tan(0.5 * np.radians(theta)))


def test_lens_turns_back_where_the_angle_stops_growing() -> None:
    # f - rho f' = 100 - 0.001 rho^2 with f = 100 + 0.001 rho^2: a fold at 316.2 px.
    lens, radius = OCamLens((100.0, 0.0, 0.001)), math.sqrt(1e5)
    assert math.isinf(theta_deg_from_radius(lens, 316.3))
    assert lens.fold_rad == pytest.approx(math.atan2(radius, 100.0 + 0.001 * radius**2))


@pytest.mark.parametrize("polynomial", [(), (0.0, 1.0), (-5.0,), (1.0, math.nan)])
def test_impossible_lens_is_rejected(polynomial: tuple[float, ...]) -> None:
    with pytest.raises(DomainError):
        OCamLens(polynomial)
