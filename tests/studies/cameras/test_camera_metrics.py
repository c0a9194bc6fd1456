"""Numbers of cameras against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.lenses import EquidistantLens, OrthographicLens
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies.cameras.camera_metrics import (
    covered_sphere,
    floor_view,
    resolution_at,
    resolution_curve,
    ring_pixels,
)
from helpers.worlds import make_omni_camera


def make_camera(field_deg: float) -> OmniCamera:
    return make_omni_camera(mirror=EquidistantLens(), rim_deg=0.5 * field_deg)


@pytest.mark.parametrize("field_deg", [90.0, 185.0, 220.0, 360.0])
def test_covered_sphere_is_that_of_a_cone(field_deg: float) -> None:
    expected = 0.5 * (1.0 - math.cos(math.radians(0.5 * field_deg)))
    assert covered_sphere(make_camera(field_deg)) == pytest.approx(expected, abs=1e-9)


def test_covered_sphere_is_less_where_the_image_ends_before_the_rim() -> None:
    camera = make_camera(180.0)
    cropped = replace(camera, height_px=100, centre_px=(100.0, 50.0))
    assert 0.5 * covered_sphere(camera) < covered_sphere(cropped) < covered_sphere(camera)


@pytest.mark.parametrize(
    ("field_deg", "expected"),
    [(200.0, (1.0, 0.5 * math.pi)), (170.0, (math.nan, math.nan))],
    ids=["shown", "beyond the rim"],
)
def test_resolution_of_an_equidistant_lens_at_90_degrees(field_deg, expected) -> None:
    resolution = resolution_at(make_camera(field_deg), math.radians(90.0))
    assert resolution == pytest.approx(expected, nan_ok=True)


def test_resolution_on_the_axis_is_the_same_in_both_directions() -> None:
    radial, tangential = resolution_curve(make_camera(200.0), np.array([0.0]))
    assert radial == tangential == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("camera", "view"),
    [
        (make_camera(185.0), (0.0, math.inf)),
        # The image begins 50 px below the axis: no circle around the axis is whole.
        (replace(make_camera(180.0), centre_px=(100.0, -50.0)), (math.inf, 0.0)),
    ],
    ids=["with the horizon", "without the axis"],
)
def test_floor_has_no_end_or_is_not_seen(camera: OmniCamera, view: tuple[float, float]) -> None:
    assert floor_view(camera, 0.6) == view


def test_floor_of_a_narrow_lens_ends_at_its_rim() -> None:
    camera = make_omni_camera(mirror=OrthographicLens(), width_px=90, rim_deg=60.2)
    _, reach_m = floor_view(camera, 0.6)
    assert reach_m == pytest.approx(0.6 * math.tan(math.radians(60.2)), abs=1e-5)


def test_ring_has_the_radius_of_its_angle_and_none_beyond_the_rim() -> None:
    camera = make_camera(220.0)
    radius = np.hypot(*(ring_pixels(camera, math.radians(60.0)) - camera.centre_px).T)
    np.testing.assert_allclose(radius, camera.scale_px * math.radians(60.0), atol=1e-9)
    assert np.isnan(ring_pixels(camera, math.radians(120.0))).all()
