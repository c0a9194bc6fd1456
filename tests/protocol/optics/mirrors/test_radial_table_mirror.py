"""Measured mirror by angles and image radii: known mirrors from their tables, and bad tables."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import EquiangularMirror, RadialTableMirror, SphericalMirror
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from helpers.mirror_checks import assert_is_mirror

ANGLES_DEG = tuple(np.linspace(0.0, 120.0, 81).tolist())
KNOWN: list[tuple[NonCentralMirror, float]] = [
    (EquiangularMirror(11.0, 0.1), 0.1),
    (SphericalMirror(0.03, 0.2), 0.17),
]


def table_of(mirror: NonCentralMirror, vertex_distance_m: float) -> RadialTableMirror:
    t = np.tan(0.5 * np.radians(ANGLES_DEG))
    radii = tuple(mirror.radius_ratio_from_t(t).tolist())
    return RadialTableMirror(ANGLES_DEG, radii, vertex_distance_m)


@pytest.mark.parametrize(("mirror", "vertex_distance_m"), KNOWN)
def test_table_of_a_mirror_is_that_mirror_with_its_surface(
    mirror: NonCentralMirror, vertex_distance_m: float
) -> None:
    table = table_of(mirror, vertex_distance_m)
    assert_is_mirror(table)
    t = np.tan(0.5 * np.radians([7.3, 50.1, 91.7, 119.9, 120.0]))
    ratio = mirror.radius_ratio_from_t(t)
    assert table.radius_ratio_from_t(t) == pytest.approx(ratio, rel=1e-6)
    found, expected = (one.ray_from_radius_ratio(ratio) for one in (table, mirror))
    for one, other in zip(found[1:], expected[1:], strict=True):
        # A thousandth of a millimetre.
        assert one == pytest.approx(other, abs=1e-6)
    assert table.pinhole_distance_m == pytest.approx(mirror.pinhole_distance_m, abs=1e-5)


def test_surface_has_the_slope_that_reflects_so() -> None:
    table = RadialTableMirror((0.0, 30.0, 70.0, 110.0), (0.0, 0.05, 0.11, 0.16), 0.1, 1.8)
    psi, step = np.linspace(0.005, 0.15, 29), 1e-6
    ahead, behind = table.reflect(psi + step), table.reflect(psi - step)
    slope = (ahead.depth - behind.depth) / (ahead.r - behind.r)
    assert psi + 2.0 * np.arctan(slope) == pytest.approx(table.reflect(psi).theta, abs=1e-8)


def test_rim_may_be_the_last_angle_of_the_table() -> None:
    table = table_of(*KNOWN[0])
    t, r, _ = table.ray_from_radius_ratio(np.array(table.image_radii[-1]))
    assert 2.0 * math.degrees(math.atan(t)) == pytest.approx(120.0, abs=1e-9)
    assert r > 0.0
    with pytest.raises(DomainError, match="rim"):
        RadialTableMirror(table.angles_deg, table.image_radii, 0.1, math.radians(120.001))


def test_passes_through_its_knots() -> None:
    table = table_of(*KNOWN[1])
    t = np.tan(0.5 * np.radians(table.angles_deg))
    assert table.radius_ratio_from_t(t) == pytest.approx(table.image_radii, rel=1e-13, abs=1e-16)


BAD = [
    ((0.0, 40.0, 80.0), (0.0, 0.1, 0.2), "4 to 512"),
    ((0.0, 40.0, 80.0, 120.0), (0.0, 0.1, 0.2), "4 to 512"),
    ((0.0, 40.0, 80.0, 100.0, 120.0), (0.0, 0.1, 0.15, 0.2), "needs as many image radii"),
    ((0.0, 40.0, 80.0, 120.0), (0.0, 0.1, 0.1, 0.2), "0.1 follows 0.1"),
    ((0.0, 40.0, 80.0, 120.0), (0.1, 0.12, 0.15, 0.2), "starts at 0"),
    ((0.0, 40.0, 80.0, 120.0), (0.0, 0.1, math.nan, 0.2), "finite"),
    ((0.0, 40.0, 80.0, 120.0), (0.0, 0.1, 0.101, 0.3), "turns back"),
    ((0.0, 40.0, 80.0, 175.0), (0.0, 0.1, 0.15, 0.2), "below 180 deg together"),
    # Pixels instead of focal lengths.
    ((0.0, 10.0, 20.0, 30.0), (0.0, 30.0, 60.0, 90.0), "unit of the radii"),
]


@pytest.mark.parametrize(("angles", "radii", "message"), BAD)
def test_bad_table_is_rejected_with_the_reason(
    angles: tuple[float, ...], radii: tuple[float, ...], message: str
) -> None:
    with pytest.raises(DomainError, match=message):
        RadialTableMirror(angles, radii, 0.1, 0.4)
