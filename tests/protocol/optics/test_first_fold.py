"""First roots of polynomials."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.curves import first_root


def test_first_root_is_the_smallest_inside() -> None:
    # (x - 1)(x - 2)(x + 3)
    terms = np.array([6.0, -7.0, 0.0, 1.0])
    assert first_root(terms, low=0.0, high=math.inf) == pytest.approx(1.0, abs=1e-15)
    assert first_root(terms, low=1.5, high=math.inf) == pytest.approx(2.0, abs=1e-15)
    assert math.isinf(first_root(terms, low=0.0, high=0.9))


def test_double_root_is_found() -> None:
    assert first_root(np.array([1.0, -2.0, 1.0]), low=0.0, high=2.0) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("terms", [[1.0], [0.0, 0.0], [1.0, 0.0, 1.0], [2.0, 0.0, 0.0]])
def test_polynomial_without_a_root_has_none(terms: list[float]) -> None:
    assert math.isinf(first_root(np.array(terms), low=0.0, high=math.inf))
