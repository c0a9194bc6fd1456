"""Rejection of invalid descriptions."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.world.world_description import (
    MAX_LIGHT,
    DirectionalLight,
    HemisphereLight,
    PointLight,
)

BLACK = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf, 2.0 * MAX_LIGHT])
def test_light_out_of_range_is_rejected(value: float) -> None:
    colour = (0.5, value, 0.5)
    with pytest.raises(DomainError, match="point light"):
        PointLight(BLACK, colour)
    with pytest.raises(DomainError, match="directional light"):
        DirectionalLight((0.0, 0.0, 1.0), colour)
    with pytest.raises(DomainError, match="hemisphere light"):
        HemisphereLight(BLACK, colour)


def test_brightest_light_is_accepted() -> None:
    assert PointLight(BLACK, (MAX_LIGHT, 0.0, 0.0)).intensity[0] == MAX_LIGHT
