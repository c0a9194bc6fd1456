"""Scale of an image, and the solid angle of its pixels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import (
    compute_image_scale,
    cosine_fourth,
    shows_whole_rim,
    visible_radii_px,
    wide_angle_illumination,
)
from catoptra_protocol.optics.lenses import (
    EquidistantLens,
    EquisolidLens,
    OrthographicLens,
    StereographicLens,
)
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)
CROPPED = OmniCamera(PAPER_MIRROR, 200, 100, (-30.0, 40.0), 103.0, math.radians(120.0))


def numeric_scales(camera: OmniCamera, theta: float) -> tuple[float, float]:
    """Pixels per radian along and across the radius, by differences of the projection."""
    step = 1e-6
    ring = np.array((math.sin(theta), 0.0, math.cos(theta)))
    along = np.array((math.cos(theta), 0.0, -math.sin(theta)))
    across = np.array((0.0, 1.0, 0.0))
    (forth, back), _ = pixel_from_direction(camera, ring + np.outer((step, -step), along))
    (right, left), _ = pixel_from_direction(camera, ring + np.outer((step, -step), across))
    return (
        float(np.linalg.norm(forth - back)) / (2 * step),
        float(np.linalg.norm(right - left)) / (2 * step),
    )


@pytest.mark.parametrize(
    "mirror", [PAPER_MIRROR, HyperbolicMirror(2.5, 0.1), ParabolicMirror(0.03)], ids=str
)
def test_scales_are_the_derivatives_of_the_projection(mirror: Mirror) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=360, rim_deg=105.0)
    scale = compute_image_scale(camera)
    for ring in (20, 64, 110):
        theta = 2.0 * math.atan(scale.t[ring])
        along, across = numeric_scales(camera, theta)
        assert scale.radial[ring] == pytest.approx(along, rel=1e-6)
        assert scale.tangential[ring] == pytest.approx(across, rel=1e-6)


def test_scales_reach_from_the_axis_over_the_horizon_to_the_rim() -> None:
    scale = compute_image_scale(CAMERA)
    assert scale.t[0] == 0.0
    assert 1.0 in scale.t
    assert scale.t[-1] == pytest.approx(CAMERA.rim_t)
    assert scale.radial[0] == scale.tangential[0]
    assert scale.area_weight.sum() == pytest.approx(1.0)


def test_extremes_are_those_of_the_reference() -> None:
    scale = compute_image_scale(CAMERA)
    # Derived: 0.272 degrees per pixel at the rim, 1.110 at the centre.
    assert math.degrees(1.0 / scale.max_px_per_rad) == pytest.approx(0.272, abs=5e-4)
    assert math.degrees(1.0 / scale.radial[0]) == pytest.approx(1.110, abs=5e-3)
    assert scale.radial[0] < scale.rms_px_per_rad < scale.max_px_per_rad


def test_radii_of_a_cropped_image_are_the_visible_ones() -> None:
    nearest, farthest = visible_radii_px(CROPPED)
    assert nearest == 30.0
    assert farthest == CROPPED.rim_radius_px
    small = replace(CROPPED, width_px=40, height_px=60)
    assert visible_radii_px(small)[1] == pytest.approx(math.hypot(70.0, 40.0))


@pytest.mark.parametrize(("camera", "whole"), [(CAMERA, True), (CROPPED, False)])
def test_whole_rim_is_known_from_a_part(camera: OmniCamera, whole: bool) -> None:
    assert shows_whole_rim(camera) is whole


def test_fourth_power_of_the_cosine_needs_no_angle() -> None:
    angle = np.radians([0.0, 30.0, 89.9])
    assert cosine_fourth(np.tan(angle)) == pytest.approx(np.cos(angle) ** 4, rel=1e-12)


def test_illumination_is_the_solid_angle_of_a_pixel() -> None:
    theta = np.radians([0.0, 1e-7, 45.0, 90.0, 110.0])
    t = np.tan(0.5 * theta)
    equidistant = np.sinc(theta / math.pi)
    assert wide_angle_illumination(EquidistantLens(), t) == pytest.approx(equidistant, abs=1e-12)
    assert wide_angle_illumination(EquisolidLens(), t) == pytest.approx(np.ones(5), abs=1e-12)
    stereographic = np.cos(0.5 * theta) ** 4
    assert wide_angle_illumination(StereographicLens(), t) == pytest.approx(stereographic)


def test_no_lens_is_brighter_than_on_its_axis() -> None:
    # 1 / cos(theta) by the formula: infinite at 90 degrees.
    t = np.tan(0.5 * np.radians([0.0, 60.0, 90.0]))
    assert wide_angle_illumination(OrthographicLens(), t) == pytest.approx(np.ones(3))
