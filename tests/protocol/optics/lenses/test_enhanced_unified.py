"""UCM and EUCM: identity with the unified sphere, published formula, domain."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import EnhancedUnifiedLens, UnifiedLens
from helpers.lens_checks import assert_is_projection, assert_rejects, limit_rad, radii

SHAPES = [(0.0, 1.0), (0.3, 0.9), (0.5, 1.2), (0.6, 1.1), (0.8, 1.0)]


@pytest.mark.parametrize(("alpha", "beta"), SHAPES)
def test_lens_is_a_projection_up_to_its_limit(alpha: float, beta: float) -> None:
    lens = EnhancedUnifiedLens(alpha, beta)
    assert_is_projection(lens, to_rad=0.97 * limit_rad(lens))
    assert_rejects(lens, lens.t_limit * 1.001)


@pytest.mark.parametrize("xi", [0.0, 0.5, 0.9954941783, 2.0])
def test_sphere_is_the_unified_lens(xi: float) -> None:
    lens, unified = EnhancedUnifiedLens(xi / (1.0 + xi)), UnifiedLens(xi)
    theta = np.degrees(0.95 * limit_rad(unified)) * np.linspace(0.0, 1.0, 9)
    assert radii(lens, *theta) / (1.0 + xi) == pytest.approx(radii(unified, *theta), rel=1e-12)
    assert limit_rad(lens) == pytest.approx(limit_rad(unified))


@pytest.mark.parametrize("parameters", [(-0.1, 1.0), (1.1, 1.0), (0.5, 0.0), (0.5, math.nan)])
def test_impossible_lens_is_rejected(parameters: tuple[float, float]) -> None:
    with pytest.raises(DomainError):
        EnhancedUnifiedLens(*parameters)
