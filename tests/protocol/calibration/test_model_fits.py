"""Cameras in the models of other programs: exact where they are one of them, else fitted."""

from __future__ import annotations

import math
from collections.abc import Callable

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
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    EquidistantLens,
    UnifiedLens,
)
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import PAPER, THETA_BACK, TUM_VI, TUM_VI_KB


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
def test_whole_sphere_is_fitted_or_refused_by_every_format(side_px: int) -> None:
    camera = camera_with_inscribed_rim(
        EquidistantLens(), width_px=side_px, height_px=side_px, rim_rad=math.pi
    )
    for fit in (fit_eucm, fit_double_sphere):
        with pytest.raises(DomainError, match="does not reach this camera's rim"):
            fit(camera)
    for fit in (fit_mei, fit_ucm):
        residual = compute_residual(camera, fit(camera))
        assert residual.max_px > 1.0 or residual.fraction_missing > 0.5, "none is equidistant"
