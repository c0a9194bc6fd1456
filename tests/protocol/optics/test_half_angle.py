"""Half-angle tangents of directions."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from catoptra_protocol.optics.numerics import half_angle_tangent


@pytest.mark.parametrize(
    "place",
    [
        (1e-300, 0.0, 1.0),
        (1e-9, 1e-9, 1.0),
        (1.0, 0.0, 0.0),
        (1.0, 0.0, -0.0),
        (1.0, 0.0, 1e-17),
        (1.0, 0.0, -1e-17),
        (0.3, -0.4, -0.2),
        (1e-8, 0.0, -1.0),
        (1e-300, 0.0, -1.0),
    ],
)
def test_half_angle_in_a_hard_case_is_that_of_50_digits(
    place: tuple[float, float, float],
) -> None:
    with mpmath.workdps(50):
        x, y, z = map(mpmath.mpf, place)
        norm, rho = mpmath.sqrt(x * x + y * y + z * z), mpmath.hypot(x, y)
        # At the antipode 50 digits cancel too: the other form there.
        exact = float(rho / (norm + z) if z >= 0 else (norm - z) / rho)
    t, valid = half_angle_tangent(np.array(place))
    assert valid
    assert t == pytest.approx(exact, rel=1e-15)
