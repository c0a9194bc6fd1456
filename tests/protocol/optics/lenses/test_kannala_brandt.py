"""Kannala-Brandt lens: published calibrations, fold, OpenCV below 90 degrees."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import DoubleSphereLens, KannalaBrandtLens
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.radial_camera import Picture
from helpers.lens_checks import assert_is_projection, assert_rejects, limit_rad, radii

TUM_VI = KannalaBrandtLens(0.00348239, 0.00071503, -0.00205324, 0.00020294)
LUMIX = KannalaBrandtLens(-0.030687, -0.003343, -0.002882, -0.000592)


@pytest.mark.parametrize("lens", [TUM_VI, LUMIX, KannalaBrandtLens()])
def test_published_lens_is_a_projection_up_to_its_limit(lens: KannalaBrandtLens) -> None:
    assert_is_projection(lens, to_rad=0.995 * limit_rad(lens))
    assert_rejects(lens)


def test_lens_ends_where_its_polynomial_turns_back() -> None:
    fold_deg = math.degrees(LUMIX.fold_rad)
    assert fold_deg == pytest.approx(93.279, abs=1e-3)
    before, at_fold = radii(LUMIX, fold_deg - 1e-3, fold_deg)
    assert before < at_fold
    with pytest.raises(DomainError, match="limit"):
        radii(LUMIX, fold_deg + 1e-3)
    with pytest.raises(DomainError, match=r"93\.279 deg, where its image radius turns back"):
        OmniCamera(LUMIX, 960, 540, (480.0, 270.0), 441.7, math.radians(94.0))


def test_pixels_are_those_of_opencv_s_fisheye_module() -> None:
    rim = math.radians(89.0)
    camera = OmniCamera(TUM_VI, 512, 512, (255.5, 257.5), 190.978, rim, 0.0, Picture.FLIPPED)
    direction = np.random.default_rng(3).normal(size=(500, 3))
    pixel, valid = pixel_from_direction(camera, direction)
    # OpenCV's axes: x right, y down, z forward; ours: x up in the image, y right, z forward.
    points = np.stack((direction[:, 1], -direction[:, 0], direction[:, 2]), axis=-1)
    matrix = np.array([[190.978, 0.0, 255.0], [0.0, 190.978, 257.0], [0.0, 0.0, 1.0]])
    terms = np.array([TUM_VI.k1, TUM_VI.k2, TUM_VI.k3, TUM_VI.k4])
    at_rest = np.zeros(3)
    found, _ = cv2.fisheye.projectPoints(points[None, valid], at_rest, at_rest, matrix, terms)
    assert valid.sum() > 100
    assert pixel[valid] - 0.5 == pytest.approx(found[0], abs=1e-9)


def test_two_published_models_of_one_lens_differ_by_less_than_a_pixel() -> None:
    # The first camera of TUM-VI by Kannala-Brandt and by a double sphere.
    other = DoubleSphereLens(-0.17213, 0.59312)
    difference = 190.978 * radii(TUM_VI, 50.0, 90.0) - 158.286 * radii(other, 50.0, 90.0)
    assert np.abs(difference) == pytest.approx((0.27, 0.76), abs=0.03)
