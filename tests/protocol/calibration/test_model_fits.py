"""Parameters of the unified model, residuals, and fits of other models."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.calibration.model_fits import (
    compute_residual,
    fit_double_sphere,
    fit_eucm,
    fit_f_theta,
    fit_kannala_brandt,
    fit_mei,
    fit_ocam,
    fit_ucm,
    fit_woodscape,
    unified_parameters,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    EquidistantLens,
    StereographicLens,
    UnifiedLens,
)
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection
from helpers.calibrated_cameras import PAPER, THETA_BACK, TUM_VI, TUM_VI_KB

ALL: list[RadialProjection] = [
    PAPER_MIRROR,
    ParabolicMirror(0.03),
    StereographicLens(),
    UnifiedLens(0.7, 0.1, 0.01),
    EnhancedUnifiedLens(0.4),
    DoubleSphereLens(0.0, 0.6),
    DoubleSphereLens(0.5, 0.0),
]


@pytest.mark.parametrize("projection", ALL)
def test_radius_is_mei_s(projection: RadialProjection) -> None:
    camera = camera_with_inscribed_rim(
        projection, width_px=360, height_px=360, rim_rad=math.radians(95.0)
    )
    unified = unified_parameters(camera)
    theta = np.radians(np.linspace(0.0, 95.0, 20))
    m = np.sin(theta) / (unified.xi + np.cos(theta))
    expected = unified.gamma_px * m * (1.0 + unified.k1 * m**2 + unified.k2 * m**4)
    assert camera.radius_px_from_t(np.tan(0.5 * theta)) == pytest.approx(expected, rel=1e-12)
    assert unified.focal_length_px * (1.0 + unified.xi) == pytest.approx(unified.gamma_px)


def test_numbers_of_the_paper_s_camera_are_those_of_the_reference() -> None:
    camera = camera_with_inscribed_rim(
        PAPER_MIRROR, width_px=360, height_px=360, rim_rad=math.radians(120.0)
    )
    unified = unified_parameters(camera)
    assert unified.xi == pytest.approx(0.9954941783, abs=1e-10)
    assert unified.gamma_px == pytest.approx(102.98653, abs=1e-5)
    assert unified.alpha == pytest.approx(0.498871001, abs=1e-9)
    assert unified.focal_length_px == pytest.approx(51.609537, abs=1e-6)


@pytest.mark.parametrize(
    "projection", [EquidistantLens(), EnhancedUnifiedLens(0.4, 1.1), DoubleSphereLens(0.3, 0.2)]
)
def test_projection_that_is_no_sphere_is_refused(projection: RadialProjection) -> None:
    camera = camera_with_inscribed_rim(projection, width_px=9, height_px=9, rim_rad=1.0)
    with pytest.raises(DomainError, match="no unified sphere"):
        unified_parameters(camera)


def test_camera_has_no_residual_to_itself_turned_or_flipped() -> None:
    turned = replace(PAPER, image_up_azimuth_rad=0.7)
    for other in (PAPER, PAPER.with_picture(Picture.FLIPPED), turned):
        residual = compute_residual(PAPER, other)
        assert residual.max_px < 1e-10
        assert residual.fraction_missing < 1e-3


def test_displaced_centre_is_the_residual() -> None:
    u, v = PAPER.centre_px
    residual = compute_residual(PAPER, replace(PAPER, centre_px=(u + 0.3, v)))
    assert residual.max_px == pytest.approx(0.3)
    assert residual.rms_px == pytest.approx(0.3)
    assert 0.0 < residual.rms_deg < residual.max_deg


def test_two_published_models_of_one_lens_differ_by_what_is_known() -> None:
    centred = replace(TUM_VI_KB, centre_px=TUM_VI.centre_px)
    assert 0.5 < compute_residual(TUM_VI, centred).max_px < 2.0


def test_model_that_ends_earlier_misses_a_part() -> None:
    narrow = replace(PAPER, rim_rad=math.radians(90.0))
    residual = compute_residual(PAPER, narrow)
    # (h / rim)^2 of the disc is left.
    left = (PAPER.horizon_radius_px / PAPER.rim_radius_px) ** 2
    assert residual.fraction_missing == pytest.approx(1.0 - left, abs=0.01)


def fisheye(field_deg: float) -> OmniCamera:
    return camera_with_inscribed_rim(
        EquidistantLens(),
        width_px=640,
        height_px=640,
        rim_rad=math.radians(0.5 * field_deg),
        picture=Picture.FLIPPED,
    )


@pytest.mark.parametrize("fit", [fit_mei, fit_ucm, fit_eucm, fit_double_sphere])
def test_paper_s_mirror_is_a_unified_sphere_exactly(
    fit: Callable[[OmniCamera], OmniCamera],
) -> None:
    residual = compute_residual(PAPER, fit(PAPER))
    assert residual.max_px < 1e-9
    assert residual.fraction_missing == 0.0


def test_double_sphere_of_a_unified_one_has_no_second_sphere() -> None:
    # With xi in its place the pixels are the same, but its readers end at 134.9 degrees.
    lens = fit_double_sphere(PAPER).projection
    assert isinstance(lens, DoubleSphereLens)
    assert lens.xi == 0.0
    turned = fit_double_sphere(
        camera_with_inscribed_rim(
            DoubleSphereLens(0.9, 0.0), width_px=360, height_px=360, rim_rad=2.0
        )
    ).projection
    assert isinstance(turned, DoubleSphereLens)
    assert turned.xi == 0.0


def test_camera_of_a_model_stays_what_it_is() -> None:
    assert fit_double_sphere(TUM_VI) is TUM_VI
    assert fit_kannala_brandt(TUM_VI_KB) is TUM_VI_KB
    assert fit_mei(THETA_BACK).projection == THETA_BACK.projection
    assert fit_mei(THETA_BACK).plane == THETA_BACK.plane


@pytest.mark.parametrize(("degree", "max_px"), [(2, 0.23), (3, 0.030), (4, 3.0e-4), (5, 2.1e-5)])
def test_ocam_s_polynomial_of_the_paper_s_mirror_is_that_good(degree: int, max_px: float) -> None:
    residual = compute_residual(PAPER, fit_ocam(PAPER, degree=degree))
    assert 0.3 * max_px < residual.max_px <= max_px
    assert residual.fraction_missing == 0.0


def test_kannala_brandt_of_the_paper_s_mirror_is_within_a_twentieth_of_a_pixel() -> None:
    residual = compute_residual(PAPER, fit_kannala_brandt(PAPER))
    assert 0.01 < residual.max_px < 0.04


def test_polynomials_of_too_low_a_degree_are_far_off() -> None:
    assert compute_residual(PAPER, fit_woodscape(PAPER)).max_px == pytest.approx(0.76, abs=0.05)
    assert compute_residual(PAPER, fit_f_theta(PAPER)).max_px == pytest.approx(0.47, abs=0.05)


def test_equidistant_lens_is_exact_in_all_polynomials_of_the_angle() -> None:
    for fit in (fit_kannala_brandt, fit_woodscape, fit_f_theta):
        assert compute_residual(fisheye(220.0), fit(fisheye(220.0))).max_px < 1e-9


def test_fit_of_one_lens_in_two_models_is_as_near_as_the_models_can_be() -> None:
    # TUM-VI's double sphere: four terms of the angle describe it, one sphere without a second not.
    assert compute_residual(TUM_VI, fit_kannala_brandt(TUM_VI)).max_px < 2e-3
    assert compute_residual(TUM_VI, fit_eucm(TUM_VI)).max_px < 0.05
    assert compute_residual(TUM_VI, fit_ucm(TUM_VI)).max_px > 0.5


def test_fitted_parameters_are_those_that_made_the_image() -> None:
    # Radii of a model that the fit does not recognise, by the other parameters of the same sphere.
    camera = camera_with_inscribed_rim(
        EnhancedUnifiedLens(0.58, 1.1), width_px=500, height_px=500, rim_rad=1.7
    )
    found = fit_mei(camera)
    assert isinstance(found.projection, UnifiedLens)
    assert compute_residual(camera, found).max_px < 0.5
    double = fit_double_sphere(
        camera_with_inscribed_rim(
            UnifiedLens(1.2, -0.02, 0.001), width_px=500, height_px=500, rim_rad=1.7
        )
    )
    assert isinstance(double.projection, DoubleSphereLens)


@pytest.mark.parametrize("side_px", [320, 640])
def test_whole_sphere_is_no_fit_of_any_sphere_model(side_px: int) -> None:
    camera = camera_with_inscribed_rim(
        EquidistantLens(), width_px=side_px, height_px=side_px, rim_rad=math.pi
    )
    for fit in (fit_eucm, fit_double_sphere, fit_mei, fit_ucm):
        residual = compute_residual(camera, fit(camera))
        assert residual.max_px > 1.0 or residual.fraction_missing > 0.5, "none is equidistant"
