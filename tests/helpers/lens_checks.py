"""Checks that every lens model passes: inverse, slope, growth, domain."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialProjection


def limit_rad(lens: RadialProjection) -> float:
    """Angle of a lens's limit."""
    return 2.0 * math.atan(lens.t_limit)


def assert_is_projection(lens: RadialProjection, *, to_rad: float | None = None) -> None:
    """Check a lens at 2001 angles from the axis to an angle, its limit by default."""
    last = limit_rad(lens) * (1.0 - 1e-9) if to_rad is None else to_rad
    theta = np.linspace(0.0, last, 2001)
    t = np.tan(0.5 * theta)
    radius = lens.radius_ratio_from_t(t)
    assert radius[0] == 0.0
    assert (np.diff(radius) > 0.0).all(), "the image radius grows"
    back = lens.t_from_radius_ratio(radius)
    # 2e-10 px of an image whose rim has 1000 px; next to a fold angles have no more digits.
    again = lens.radius_ratio_from_t(np.minimum(back, lens.t_limit))
    assert np.abs(again - radius).max() <= 2e-13 * radius[-1]
    # Central differences; next to the axis and a fold they have no digits themselves.
    inner = theta[20:-200]
    step = 1e-6
    ahead, behind = (lens.radius_ratio_from_t(np.tan(0.5 * (inner + s))) for s in (step, -step))
    slope = lens.radius_ratio_slope(np.tan(0.5 * inner))
    assert (ahead - behind) / (2.0 * step) == pytest.approx(slope, rel=1e-6)
    on_axis = lens.radius_ratio_slope(np.array(0.0))
    assert lens.radius_ratio_from_t(np.array(1e-9)) == pytest.approx(2e-9 * on_axis, rel=1e-6)


def assert_rejects(lens: RadialProjection, *beyond: float) -> None:
    """Check that a lens rejects no number, negative values and values of t beyond its limit."""
    for value in (-1e-9, math.nan, *beyond):
        with pytest.raises(DomainError):
            lens.radius_ratio_from_t(np.array(value))
        with pytest.raises(DomainError):
            lens.radius_ratio_slope(np.array(value))
    for value in (-1e-9, math.nan):
        with pytest.raises(DomainError):
            lens.t_from_radius_ratio(np.array(value))


def radii(lens: RadialProjection, *theta_deg: float) -> Floats:
    """Image radii of angles in degrees."""
    return lens.radius_ratio_from_t(np.tan(0.5 * np.radians(theta_deg)))


def theta_deg_from_radius(lens: RadialProjection, radius: float) -> float:
    """Angle of an image radius in degrees; inf where none has it."""
    t = float(lens.t_from_radius_ratio(np.array(radius)))
    return math.inf if math.isinf(t) else math.degrees(2.0 * math.atan(t))
