from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects import SceneSummary
from catoptra_server.effects.kernels.convolution import pair_multiplicities
from catoptra_server.effects.medium.diffraction import (
    WAVELENGTHS_M,
    Diffraction,
    kernel_half_width_px,
    kernel_weights,
)
from helpers.blur_measurement import make_point_source
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, max_grey_level_change

PITCH_M = 7.4e-6
DAYLIGHT = SceneSummary(1.0)
# Energy within the first dark ring: 1 - J0(3.8317)^2.
IN_DISC = 0.83779


def make_diffraction(f_number: float) -> Diffraction:
    return Diffraction(f_number, PITCH_M)


def truncated_fraction(effect: Diffraction) -> Floats:
    """Fraction of each colour's light, (3,), outside the kernel."""
    return 1.0 - pair_multiplicities(kernel_half_width_px(effect)) @ effect.airy_pattern()


@pytest.mark.parametrize(("f_number", "diameter_px"), [(4.0, 0.725), (8.0, 1.450)])
def test_airy_disc_of_550_nm_has_the_textbooks_diameter(
    f_number: float, diameter_px: float
) -> None:
    assert make_diffraction(f_number).airy_diameter_px(550e-9) == pytest.approx(
        diameter_px, abs=1e-3
    )


@pytest.mark.parametrize("f_number", [1.0, 4.0, 8.0, 22.0])
def test_kernel_of_each_colour_keeps_all_light_and_loses_little_before(f_number: float) -> None:
    effect = make_diffraction(f_number)
    assert pair_multiplicities(kernel_half_width_px(effect)) @ kernel_weights(
        effect
    ) == pytest.approx(1.0, abs=1e-13)
    assert kernel_weights(effect).min() >= 0.0
    assert 0.0 < truncated_fraction(effect).max() < 0.031


def test_encircled_energy_of_the_pattern_is_that_of_rayleighs_formula() -> None:
    """At an f-number so large that pixels resolve the rings."""
    effect = make_diffraction(64.0)
    half_width = kernel_half_width_px(effect)
    shares = effect.airy_pattern()[:, 1]
    sizes = pair_multiplicities(half_width)
    unit_px = 540e-9 * 64.0 / PITCH_M
    half_px = half_width + 0.5
    # Beyond a circle 2 / (pi v); beyond a square the mean of that over all angles.
    v = math.pi * half_px / unit_px
    left = 4.0 * math.sqrt(0.5) * 2.0 / (math.pi**2 * v)
    assert 1.0 - sizes @ shares == pytest.approx(left, rel=0.05)
    # The central pixel: (pi / 4) / unit^2 of all light per px^2, J1(v)^2 / v^2 close to 1 / 4.
    assert shares[0] == pytest.approx(0.25 * math.pi / unit_px**2, rel=0.02)


def spread_point(effect: Diffraction) -> Floats:
    return effect.apply(make_point_source(CAMERA, 48, 48), CAMERA, CAPTURE_CONTEXT)


def central_pixel_fraction(effect: Diffraction) -> float:
    """Fraction of a red point's light in the central pixel."""
    return float(spread_point(effect)[48, 48, 0])


@pytest.mark.parametrize("f_number", [1.0, 2.8, 4.0, 4.9])
def test_lens_when_disabled_would_leave_the_disc_of_every_point_in_its_pixel(
    f_number: float,
) -> None:
    effect = make_diffraction(f_number)
    assert effect.bound(DAYLIGHT, CAMERA).displacement_px <= 0.5
    assert central_pixel_fraction(effect) >= IN_DISC


@pytest.mark.parametrize("f_number", [5.0, 5.6, 8.0, 16.0, 32.0])
def test_lens_when_enabled_spreads_light_farther_than_half_the_threshold(f_number: float) -> None:
    effect = make_diffraction(f_number)
    bound = effect.bound(DAYLIGHT, CAMERA)
    assert bound.displacement_px > 0.5
    assert "Airy disc" in bound.reason
    # Even with the pixel's light spread evenly, a square of a quarter of a pixel around the centre
    # would have less than the disc's light.
    within_quarter_px = central_pixel_fraction(effect) * (2.0 * 0.25) ** 2
    assert within_quarter_px < IN_DISC


@pytest.mark.parametrize("f_number", [8.0, 16.0, 32.0])
def test_bound_when_wider_than_a_pixel_encloses_the_discs_light(f_number: float) -> None:
    effect = make_diffraction(f_number)
    v, u = np.mgrid[:96, :96]
    distance = np.hypot(u - 48, v - 48)
    radius = effect.bound(DAYLIGHT, CAMERA).displacement_px
    enclosed = [
        float(spread_point(effect)[distance <= radius + by, 0].sum()) for by in (-0.71, 0.71)
    ]
    # Pixels wholly within the ring, and all pixels that the ring touches.
    assert enclosed[0] < IN_DISC / (1.0 - truncated_fraction(effect)[0]) < enclosed[1] + 1e-3


def test_light_of_a_point_is_kept_in_each_colour_and_red_is_widest() -> None:
    measured = spread_point(make_diffraction(8.0))
    np.testing.assert_allclose(measured.sum(axis=(0, 1)), 1.0, rtol=1e-12)
    assert measured[48, 48, 0] < measured[48, 48, 1] < measured[48, 48, 2]


@pytest.mark.parametrize("f_number", [1.0, 4.0, 16.0])
def test_bound_in_grey_levels_holds_for_edges(f_number: float) -> None:
    effect = make_diffraction(f_number)
    bound = effect.bound(DAYLIGHT, CAMERA).value
    points = np.zeros((CAMERA.height_px, CAMERA.width_px, 3))
    points[::9, ::9] = 1.0
    changes = [max_grey_level_change(effect, image) for image in (points, 1.0 - points)]
    assert 0.3 * bound < max(changes) <= bound * (1.0 + 1e-9)


def test_pattern_far_narrower_than_a_pixel_needs_no_quadrature_of_its_rings() -> None:
    # On both sides of the limit the neighbours receive the same light, in proportion.
    wide, narrow = (
        kernel_weights(Diffraction(4.0, 4.0 * WAVELENGTHS_M[0] / lambda_n_px))
        for lambda_n_px in (0.0185, 0.0175)
    )
    others = [1.0 - one[0, 0] for one in (wide, narrow)]
    assert others[0] / 0.0185 == pytest.approx(others[1] / 0.0175, rel=0.05)
    # Sensors of millimetres are allowed: 13 000 nodes took minutes.
    assert kernel_weights(Diffraction(0.7, 1e-3))[0].min() > 0.9995
