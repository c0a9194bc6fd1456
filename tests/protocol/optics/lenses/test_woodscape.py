"""WoodScape lens: the published calibration, and its polynomial."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import WoodScapeLens
from helpers.lens_checks import assert_is_projection, assert_rejects, radii

FRONT = WoodScapeLens(339.749, -31.988, 48.275, -7.201)


def test_published_lens_is_its_polynomial() -> None:
    assert_is_projection(FRONT)
    assert_rejects(FRONT)
    theta = math.radians(80.0)
    expected = 339.749 * theta - 31.988 * theta**2 + 48.275 * theta**3 - 7.201 * theta**4
    assert radii(FRONT, 80.0) == pytest.approx(expected)


def test_lens_turns_back_where_its_slope_is_zero() -> None:
    lens = WoodScapeLens(100.0, -25.0)
    assert lens.fold_rad == pytest.approx(2.0)
    with pytest.raises(DomainError, match="limit"):
        radii(lens, 115.0)


def test_lens_that_shrinks_from_the_axis_is_rejected() -> None:
    with pytest.raises(DomainError, match="grow from the axis"):
        WoodScapeLens(0.0, 1.0)
