"""Equiangular mirror: constant gain, reflection by the surface's own slope."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import EquiangularMirror
from helpers.mirror_checks import assert_is_mirror

MIRROR = EquiangularMirror(11.0, 0.1)


@pytest.mark.parametrize("mirror", [MIRROR, EquiangularMirror(3.0, 0.05, math.radians(100.0))])
def test_mirror_reflects(mirror: EquiangularMirror) -> None:
    assert_is_mirror(mirror)


def test_each_degree_of_the_camera_sees_eleven_of_the_scene() -> None:
    psi = np.radians([0.0, 1.0, 10.0])
    assert np.degrees(MIRROR.reflect(psi).theta) == pytest.approx([0.0, 11.0, 110.0])


def test_surface_has_the_slope_that_reflects_so() -> None:
    psi, step = np.linspace(0.01, 0.18, 9), 1e-6
    ahead, behind = MIRROR.reflect(psi + step), MIRROR.reflect(psi - step)
    slope = (ahead.depth - behind.depth) / (ahead.r - behind.r)
    assert psi + 2.0 * np.arctan(slope) == pytest.approx(11.0 * psi, abs=1e-8)


@pytest.mark.parametrize("parameters", [(1.0, 0.1), (11.0, 0.0), (math.inf, 0.1), (1.5, 0.1)])
def test_impossible_mirror_is_rejected(parameters: tuple[float, float]) -> None:
    # A gain of 1.5 ends at 108 degrees, before the rim of 120.
    with pytest.raises(DomainError):
        EquiangularMirror(*parameters)
