"""Double sphere: identities with one sphere, published formula, domain."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import DoubleSphereLens, EnhancedUnifiedLens, UnifiedLens
from helpers.lens_checks import assert_is_projection, assert_rejects, limit_rad, radii

TUM_VI = DoubleSphereLens(-0.17213, 0.59312)


@pytest.mark.parametrize(("xi", "alpha"), [(-0.17213, 0.59312), (0.3, 0.7), (1.5, 0.2), (0.0, 0.4)])
def test_lens_is_a_projection_up_to_its_limit(xi: float, alpha: float) -> None:
    lens = DoubleSphereLens(xi, alpha)
    assert_is_projection(lens, to_rad=0.97 * limit_rad(lens))
    assert_rejects(lens, lens.t_limit * 1.001)


def test_one_sphere_is_the_unified_model() -> None:
    theta = np.linspace(0.0, 120.0, 9)
    second = radii(DoubleSphereLens(0.0, 0.6), *theta)
    assert second == pytest.approx(radii(EnhancedUnifiedLens(0.6), *theta), rel=1e-13)
    first = radii(DoubleSphereLens(0.8, 0.0), *theta)
    assert first == pytest.approx(radii(UnifiedLens(0.8), *theta), rel=1e-13)


def test_limit_is_where_the_published_formula_ends_or_turns_back() -> None:
    def radius(lens: DoubleSphereLens, theta: float) -> mpmath.mpf:
        rho, z = mpmath.sin(theta), mpmath.cos(theta)
        d2 = mpmath.hypot(rho, lens.xi + z)
        return rho / (lens.alpha * d2 + (1 - mpmath.mpf(lens.alpha)) * (lens.xi + z))

    lenses = [TUM_VI]
    for xi, alpha in np.random.default_rng(3).uniform((-0.95, 0.01), (2.5, 0.98), (60, 2)):
        lenses.append(DoubleSphereLens(float(xi), float(alpha)))
    with mpmath.workdps(50):
        for lens in lenses:
            limit = limit_rad(lens)
            inside = [radius(lens, limit * (1 - mpmath.mpf(f))) for f in (0.1, 1e-3, 1e-9)]
            assert 0 < inside[0] < inside[1] < inside[2]
            beyond = limit * (1 + mpmath.mpf(1e-9))
            if beyond < math.pi:
                # Behind a pole the radius is negative, after a fold it falls.
                assert radius(lens, beyond * (1 + mpmath.mpf(1e-9))) < radius(lens, beyond) or (
                    radius(lens, beyond) < 0
                )


@pytest.mark.parametrize("xi", [-0.9, -0.5, -0.17213, 0.3, 1.5])
@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.59312, 0.9])
def test_lens_is_a_projection_for_spheres_on_either_side(xi: float, alpha: float) -> None:
    lens = DoubleSphereLens(xi, alpha)
    assert_is_projection(lens, to_rad=0.98 * limit_rad(lens))


@pytest.mark.parametrize(
    "parameters", [(-1.0, 0.5), (0.0, 1.0), (0.0, -0.1), (math.nan, 0.5), (1e155, 0.5)]
)
def test_impossible_lens_is_rejected(parameters: tuple[float, float]) -> None:
    with pytest.raises(DomainError):
        DoubleSphereLens(*parameters)
