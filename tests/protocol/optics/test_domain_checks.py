"""Domain checks: the error names the element and carries the mask."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import require_domain


def test_require_when_all_is_inside_raises_nothing() -> None:
    require_domain(np.ones((2, 3), dtype=bool), np.zeros((2, 3)), "anything")
    require_domain(True, 1.0, "anything")


def test_require_when_an_element_is_outside_names_it_and_carries_the_mask() -> None:
    values = np.array([[1.0, 2.0], [-3.0, -4.0]])
    with pytest.raises(
        DomainError, match=r"-3\.0 \(element 1, 0\) is outside .*: above 0"
    ) as raised:
        require_domain(values > 0.0, values, "above 0")
    assert raised.value.valid_mask.tolist() == [[True, True], [False, False]]


def test_require_when_a_vector_is_outside_names_the_vector() -> None:
    with pytest.raises(DomainError, match=r"\[1\.0, 2\.0\] \(element 1\)"):
        require_domain(np.array([True, False]), np.array([[0.0, 0.0], [1.0, 2.0]]), "zero")


def test_require_when_a_single_number_is_outside_names_no_element() -> None:
    with pytest.raises(DomainError, match=r"^nan is outside"):
        require_domain(False, np.nan, "a number")
