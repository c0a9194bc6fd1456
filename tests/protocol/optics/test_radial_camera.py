"""Cameras and projections that depend on the angle from the axis alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import compute_image_scale, visible_radii_px
from catoptra_protocol.optics.lenses import KannalaBrandtLens, OrthographicLens
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera, describe_limit
from helpers.effect_measurement import CAMERA
from helpers.worlds import make_omni_camera


def test_limit_of_a_formula_is_an_angle() -> None:
    assert describe_limit(OrthographicLens()) == "90.000 deg"


def test_limit_by_a_fold_says_so() -> None:
    lens = KannalaBrandtLens(-0.030687, -0.003343, -0.002882, -0.000592)
    assert describe_limit(lens) == "93.279 deg, where its image radius turns back (its first fold)"


def test_focal_length_gives_the_angle_of_the_ray_to_the_mirrors_point() -> None:
    # From a point of the mirror and the pinhole alone, without a focal length.
    t = np.array(0.7 * CAMERA.rim_t)
    r, z = CAMERA.mirror.surface_point(t)
    psi = math.atan2(float(r), CAMERA.mirror.pinhole_distance_m - float(z))
    radius_px = CAMERA.scale_px * float(CAMERA.projection.radius_ratio_from_t(t))
    assert math.atan(radius_px * CAMERA.inverse_focal_length) == pytest.approx(psi, rel=1e-12)


def test_focal_length_of_an_orthographic_camera_is_infinite() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0, width_px=96)
    assert camera.inverse_focal_length == 0.0


LENS = PerspectiveCamera(320, 200, math.radians(100.0))
CAMERAS = pytest.mark.parametrize("camera", [CAMERA, LENS], ids=["mirror", "lens"])


@CAMERAS
def test_angle_of_an_image_radius_is_that_of_the_pixels_direction(camera: RadialCamera) -> None:
    radius_px = np.linspace(0.0, 0.99 * visible_radii_px(camera)[1], 7)
    angle = np.pi / 5  # towards no border's middle
    # Within the image of either camera, whose height is less than the width.
    radius_px = radius_px * 0.6
    pixel = np.stack((radius_px * math.cos(angle), radius_px * math.sin(angle)), axis=-1)
    direction, valid = camera.direction_from_pixel(pixel + camera.centre_px)
    assert valid.all()
    cosine = direction @ camera.optical_axis
    theta = 2.0 * np.arctan(camera.t_from_radius_px(radius_px))
    assert np.cos(theta) == pytest.approx(cosine, abs=1e-12)


@CAMERAS
def test_slope_of_the_image_radius_is_its_difference_quotient(camera: RadialCamera) -> None:
    radius_px = np.linspace(0.1, 0.99, 9) * camera.rim_radius_px
    step_px = 1e-4
    ends = [
        2.0 * np.arctan(camera.t_from_radius_px(radius_px + side * step_px)) for side in (-0.5, 0.5)
    ]
    slope = camera.radius_slope_px(camera.t_from_radius_px(radius_px))
    assert slope == pytest.approx(step_px / (ends[1] - ends[0]), rel=1e-6)


def test_scale_of_a_lens_is_the_focal_length_over_the_cosine() -> None:
    scale = compute_image_scale(LENS)
    cosine = np.cos(2.0 * np.arctan(scale.t))
    assert scale.radial == pytest.approx(LENS.focal_length_px / cosine**2, rel=1e-12)
    assert scale.tangential == pytest.approx(LENS.focal_length_px / cosine, rel=1e-9)
    assert scale.radius_px[-1] == pytest.approx(0.5 * math.hypot(320, 200))


def test_lens_has_no_horizon_and_its_rim_at_the_corners() -> None:
    assert math.isinf(LENS.horizon_radius_px)
    corner, valid = LENS.direction_from_pixel(np.array((0.0, 0.0)))
    assert valid
    t = LENS.t_from_radius_px(np.array(LENS.rim_radius_px))
    assert math.cos(2.0 * math.atan(float(t))) == pytest.approx(float(corner[0]), rel=1e-12)
