from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.effects.kernels.mirror_surface import mirror_surface_table
from helpers.worlds import make_omni_camera

PAPER = make_omni_camera(width_px=360)
P_M = 0.03
PARABOLIC = make_omni_camera(mirror=ParabolicMirror(P_M), width_px=360)


def test_paraboloid_when_measured_has_its_closed_form_s_area() -> None:
    surface_table = mirror_surface_table(PARABOLIC)
    steep = (1.0 + np.square(surface_table.r_m / P_M)) ** 1.5 - 1.0
    area = 2.0 * math.pi * P_M**2 / 3.0 * steep
    assert surface_table.area_m2 == pytest.approx(area[-1], rel=1e-5)
    np.testing.assert_allclose(surface_table.area_fraction, area / area[-1], atol=1e-6)


def test_paraboloid_from_afar_is_foreshortened_by_its_slope() -> None:
    surface_table = mirror_surface_table(PARABOLIC)
    px_per_m = PARABOLIC.horizon_radius_px / P_M
    r_m = np.linspace(0.0, surface_table.r_m[-1], 37)
    radius_px, radial, tangential = surface_table.interpolate(r_m)
    np.testing.assert_allclose(radius_px, px_per_m * r_m, rtol=1e-9)
    np.testing.assert_allclose(tangential, px_per_m, rtol=1e-5)
    np.testing.assert_allclose(surface_table.plan_radial_px_per_m, px_per_m, rtol=1e-9)
    np.testing.assert_allclose(radial, px_per_m / np.hypot(1.0, r_m / P_M), rtol=1e-4)


def test_hyperboloid_from_the_pinhole_is_scaled_as_in_perspective() -> None:
    surface_table = mirror_surface_table(PAPER)
    # 1 m at the vertex, 221.6 mm from a pinhole of 1086 px; the rim is 85 mm wide.
    assert surface_table.tangential_px_per_m[0] == pytest.approx(
        1086.096 / (0.2321 - 0.01052871), rel=1e-4
    )
    assert surface_table.radial_px_per_m[0] == pytest.approx(
        surface_table.tangential_px_per_m[0], rel=1e-3
    )
    assert surface_table.r_m[-1] == pytest.approx(0.042536, abs=1e-6)
    assert surface_table.tangential_px_per_m[-1] == pytest.approx(
        180.0 / surface_table.r_m[-1], rel=1e-9
    )
    assert surface_table.max_px_per_m == pytest.approx(
        surface_table.tangential_px_per_m[0], rel=1e-3
    )
    assert surface_table.max_px2_per_m2 == pytest.approx(
        surface_table.tangential_px_per_m[0] ** 2, rel=1e-3
    )


def test_fraction_when_turned_back_is_the_radius() -> None:
    surface_table = mirror_surface_table(PAPER)
    r_m = surface_table.r_from_area_fraction(np.array([0.0, 0.2, 0.7, 1.0]))
    np.testing.assert_allclose(
        np.interp(r_m, surface_table.r_m, surface_table.area_fraction), [0, 0.2, 0.7, 1], atol=1e-6
    )
