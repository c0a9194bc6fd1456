from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.effects.mirror.mirror_reflectance import MirrorReflectance
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_effect_negligible,
    assert_effect_not_negligible,
)
from helpers.worlds import make_omni_camera

ALUMINIUM = MirrorReflectance(0.96, 6.7)
STEEL = MirrorReflectance(2.8, 3.4)
ANGLES = np.radians([0.0, 10.0, 45.0, 65.0, 80.0, 89.9])


def reflectance_in_reals(angle: float, n: float, k: float) -> float:
    """Fresnel's reflectance in real numbers: a + ib is the index along the inner normal."""
    sine2, cosine = math.sin(angle) ** 2, math.cos(angle)
    real = n**2 - k**2 - sine2
    root = math.hypot(real, 2.0 * n * k)
    a, whole = math.sqrt(0.5 * (root + real)), root
    s_polarized = (whole - 2 * a * cosine + cosine**2) / (whole + 2 * a * cosine + cosine**2)
    slant = math.sin(angle) * math.tan(angle)
    p_polarized = (
        s_polarized * (whole - 2 * a * slant + slant**2) / (whole + 2 * a * slant + slant**2)
    )
    return 0.5 * (s_polarized + p_polarized)


@pytest.mark.parametrize(("n", "k"), [(0.96, 6.7), (2.8, 3.4), (1.5, 0.0)])
def test_reflectance_is_that_of_the_real_form(n: float, k: float) -> None:
    expected = [reflectance_in_reals(float(angle), n, k) for angle in ANGLES]
    np.testing.assert_allclose(MirrorReflectance(n, k).reflectance(ANGLES), expected, rtol=1e-9)


def test_glass_when_met_straight_reflects_four_hundredths() -> None:
    assert float(MirrorReflectance(1.5, 0.0).reflectance(np.array(0.0))) == pytest.approx(0.04)


def test_mirror_when_met_at_its_rim_is_met_at_half_the_sum_of_both_angles() -> None:
    r, z = CAMERA.mirror.surface_point(np.array(CAMERA.rim_t))
    psi = math.atan2(float(r), CAMERA.mirror.pinhole_distance_m - float(z))
    incidence_rad = np.array((0.0, 0.5 * (CAMERA.rim_rad + psi)))
    assert math.degrees(incidence_rad[1]) == pytest.approx(65.0, abs=0.5)
    normal, at_rim = STEEL.reflectance(incidence_rad)
    # Beyond the rim the rim's value applies.
    corner = STEEL.apply(np.ones((96, 96, 3)), CAMERA, CAPTURE_CONTEXT)[0, 0]
    np.testing.assert_allclose(corner, at_rim / normal, rtol=1e-12)


def test_centre_when_light_meets_it_straight_keeps_its_light() -> None:
    image = np.ones((97, 97, 3))
    behind = STEEL.apply(image, make_omni_camera(width_px=97), CAPTURE_CONTEXT)
    np.testing.assert_allclose(behind[48, 48], 1.0, rtol=1e-12)


def test_straight_light_is_disabled_by_the_criterion() -> None:
    assert_effect_negligible(STEEL, camera=make_omni_camera(width_px=96, rim_deg=40.0))


def test_steel_is_enabled_by_the_criterion() -> None:
    assert_effect_not_negligible(STEEL)
