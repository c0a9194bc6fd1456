"""The closed form against rays through the rim of a thin lens, in metres."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.effects.kernels.lens_blur import (
    Aperture,
    describe_lens,
    interior_mask,
    lens_focus_coordinate,
    thin_lens_circle_of_confusion,
)

CAMERA = PerspectiveCamera(640, 480, math.radians(40.0))
PITCH_M = 7.4e-6


def traced_diameter_px(aperture: Aperture, range_m: float, radius_px: float) -> float:
    """Disc of a point at a range and an image radius, by similar triangles behind the lens."""
    image_m = CAMERA.focal_length_px * PITCH_M
    focus = 1.0 / aperture.focus_distance_m if aperture.focus_distance_m else 0.0
    focal_m = 1.0 / (1.0 / image_m + focus)
    depth_m = range_m * math.cos(math.atan(radius_px * PITCH_M / image_m))
    # The point's own image, and the width of its cone of light at the sensor.
    own_image_m = 1.0 / (1.0 / focal_m - 1.0 / depth_m)
    return (
        focal_m
        / aperture.f_number
        * abs(image_m - own_image_m)
        / own_image_m
        / aperture.pixel_pitch_m
    )


@pytest.mark.parametrize("focus_m", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("radius_px", [0.0, 250.0, 400.0])
@pytest.mark.parametrize("range_m", [0.3, 1.0, 2.0, 50.0])
def test_disc_of_a_point_is_that_of_traced_rays(
    focus_m: float, radius_px: float, range_m: float
) -> None:
    aperture = Aperture(2.8, PITCH_M, focus_m)
    circle = thin_lens_circle_of_confusion(aperture, CAMERA, np.array(radius_px))
    traced = traced_diameter_px(aperture, range_m, radius_px)
    assert float(circle.diameter_px(np.array(range_m))) == pytest.approx(traced, rel=1e-9)


def test_disc_at_the_hyperfocal_distance_of_infinity_is_one_pixel() -> None:
    aperture = Aperture(2.8, PITCH_M, 0.0)
    focal_px = CAMERA.focal_length_px
    hyperfocal_m = focal_px * PITCH_M / 2.8 * focal_px
    circle = thin_lens_circle_of_confusion(aperture, CAMERA, np.array(0.0))
    assert float(circle.diameter_px(np.array(hyperfocal_m))) == pytest.approx(1.0, rel=1e-12)
    assert float(circle.diameter_px(np.array(math.inf))) == 0.0


def test_focus_coordinate_of_no_distance_is_infinity() -> None:
    assert lens_focus_coordinate(Aperture(4.0, PITCH_M, 0.0), CAMERA) == 0.0
    assert lens_focus_coordinate(Aperture(4.0, PITCH_M, 0.5), CAMERA) == 2.0


def test_lens_is_described_with_its_focus() -> None:
    assert describe_lens(Aperture(4.0, PITCH_M, 0.0), CAMERA) == "F/4, focused at infinity"
    assert describe_lens(Aperture(4.0, PITCH_M, 1.5), CAMERA) == "F/4, focused at 1.5 m"


def test_every_pixel_of_a_lens_is_interior() -> None:
    assert interior_mask(CAMERA).all()
