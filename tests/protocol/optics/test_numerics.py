"""Angles, half-angle tangents, units, and checks of domains."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import require_domain
from catoptra_server.config.camera_sections import metres_from_uu, radians_from_uu


def test_length_of_250_uu_is_a_metre() -> None:
    assert metres_from_uu(250.0) == 1.0


@pytest.mark.parametrize(
    ("angle_uu", "angle_rad"),
    [(16384.0, 0.5 * math.pi), (32768.0, math.pi), (-49152.0, -1.5 * math.pi), (0.0, 0.0)],
)
def test_angle_of_quarter_turns_is_exact(angle_uu: float, angle_rad: float) -> None:
    assert radians_from_uu(angle_uu) == pytest.approx(angle_rad, rel=1e-15)


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
