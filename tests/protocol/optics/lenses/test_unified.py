"""Unified lens: identities, published calibrations, folds, agreement with cv2.omnidir."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import UnifiedLens
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.radial_camera import Picture
from helpers.lens_checks import assert_is_projection, assert_rejects, limit_rad, radii

THETA_BACK = UnifiedLens(1.19807, -0.25709, 0.01283)
THETA_FRONT = UnifiedLens(2.94487, 0.22657, 6.7294)
KITTI_360 = UnifiedLens(2.21340475, 0.016798, 1.654877)
ALL = [THETA_BACK, THETA_FRONT, KITTI_360, UnifiedLens(0.0), UnifiedLens(0.5), UnifiedLens(1.0)]


@pytest.mark.parametrize("lens", ALL)
def test_lens_is_a_projection_up_to_its_limit(lens: UnifiedLens) -> None:
    assert_is_projection(lens, to_rad=0.98 * limit_rad(lens))
    assert_rejects(lens, *(() if lens.xi == 1.0 else (lens.t_limit * 1.001,)))


def test_lens_without_distortion_is_the_paper_s_mirror() -> None:
    theta, lens = (1.0, 45.0, 90.0, 120.0, 150.0), UnifiedLens(PAPER_MIRROR.xi)
    assert radii(lens, *theta) * lens.xi == pytest.approx(radii(PAPER_MIRROR, *theta), rel=1e-13)


def test_published_lens_ends_at_its_first_fold_and_not_at_its_formula_s_limit() -> None:
    assert math.degrees(THETA_BACK.fold_rad) == pytest.approx(118.28, abs=0.01)
    assert math.acos(-1.0 / THETA_BACK.xi) == pytest.approx(math.radians(146.6), abs=1e-3)
    for lens in (THETA_FRONT, KITTI_360):
        assert math.isinf(lens.fold_rad)
        assert limit_rad(lens) == pytest.approx(math.acos(-1.0 / lens.xi))


def test_every_distorted_lens_inverts_up_to_its_end() -> None:
    # Of 400 lenses with xi > 1, 65 had a limit that rounding placed beyond itself.
    for xi, k1, k2 in np.random.default_rng(1).uniform(
        (0.0, -0.6, -1.0), (4.0, 0.6, 1.0), (400, 3)
    ):
        lens = UnifiedLens(float(xi), float(k1), float(k2))
        radius = np.linspace(0.0, 3.0, 200)
        t = lens.t_from_radius_ratio(radius)
        inside = np.isfinite(t)
        assert lens.radius_ratio_from_t(t[inside]) == pytest.approx(radius[inside], abs=1e-11)
        assert (t[inside] <= lens.t_limit * (1.0 + 1e-12)).all()


@pytest.mark.parametrize("xi", [0.0, 0.6, 1.0, 1.3, 2.2])
def test_decentred_lens_without_a_fold_inverts_up_to_its_rim(xi: float) -> None:
    lens, plane = UnifiedLens(xi), ImagePlane(p1=1e-4, p2=-2e-4)
    rim = 0.97 * limit_rad(lens)
    camera = OmniCamera(lens, 640, 640, (320.0, 320.0), 60.0, rim, 0.0, Picture.FLIPPED, plane)
    direction = np.random.default_rng(2).normal(size=(2000, 3))
    pixel, valid = pixel_from_direction(camera, direction)
    back, known = direction_from_pixel(camera, pixel[valid])
    again, _ = pixel_from_direction(camera, back)
    assert known.mean() > 0.99
    assert again[known] == pytest.approx(pixel[valid][known], abs=1e-8)


def test_pixels_with_skew_and_tangential_distortion_are_opencv_s() -> None:
    plane = ImagePlane((1.0, 0.002, 0.0, 1.01), 1e-3, -5e-4)
    rim, hand = math.radians(112.0), Picture.FLIPPED
    camera = OmniCamera(THETA_BACK, 960, 1080, (480.0, 540.0), 400.0, rim, 0.0, hand, plane)
    direction = np.random.default_rng(1).normal(size=(4000, 3))
    pixel, valid = pixel_from_direction(camera, direction)
    points = np.stack((direction[:, 1], -direction[:, 0], direction[:, 2]), axis=-1)
    matrix = np.array([[400.0, 0.8, 479.5], [0.0, 404.0, 539.5], [0.0, 0.0, 1.0]])
    terms = np.array([THETA_BACK.k1, THETA_BACK.k2, 1e-3, -5e-4])
    at_rest = np.zeros(3)
    xi = THETA_BACK.xi
    found, _ = cv2.omnidir.projectPoints(points[None], at_rest, at_rest, matrix, xi, terms)
    assert valid.sum() > 2000
    assert (pixel - 0.5)[valid] == pytest.approx(found[0][valid], abs=1e-9)
    back, known = direction_from_pixel(camera, pixel[valid])
    unit = direction[valid] / np.linalg.norm(direction[valid], axis=-1, keepdims=True)
    assert known.all()
    assert back == pytest.approx(unit, abs=1e-11)


@pytest.mark.parametrize("parameters", [(-0.1,), (math.nan,), (1.0, math.inf)])
def test_impossible_lens_is_rejected(parameters: tuple[float, ...]) -> None:
    with pytest.raises(DomainError):
        UnifiedLens(*parameters)
