"""Rays and points of cameras with and without a viewpoint."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.camera_rays import (
    max_miss_m,
    near_limit_m,
    pixel_from_point,
    ray_from_pixel,
    rays_from_pixel_grid,
)
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.mirrors import (
    PAPER_MIRROR,
    ConicalMirror,
    EquiangularMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.omni_camera import (
    camera_with_inscribed_rim,
    direction_from_pixel_grid,
)
from catoptra_protocol.optics.radial_camera import Picture
from helpers.mirror_checks import make_camera

CENTRAL = camera_with_inscribed_rim(PAPER_MIRROR, width_px=64, height_px=48, rim_rad=2.0)
MIRRORS: list[NonCentralMirror] = [
    SphericalMirror(0.03, 0.2),
    EquiangularMirror(11.0, 0.1),
    ConicalMirror(math.radians(60.0), 0.1, math.radians(88.0)),
]


def test_rays_of_a_central_camera_begin_at_its_viewpoint() -> None:
    u, v = np.arange(64) + 0.5, np.arange(48) + 0.5
    origins, directions, valid = rays_from_pixel_grid(CENTRAL, u, v)
    expected, expected_valid = direction_from_pixel_grid(CENTRAL, u, v)
    assert origins is None
    assert np.array_equal(directions, expected)
    assert np.array_equal(valid, expected_valid)
    assert (near_limit_m(CENTRAL), max_miss_m(CENTRAL)) == (0.0, 0.0)


@pytest.mark.parametrize("mirror", MIRRORS, ids=lambda mirror: type(mirror).__name__)
@pytest.mark.parametrize("picture", list(Picture))
def test_point_on_a_pixel_s_ray_has_that_pixel(mirror: NonCentralMirror, picture: Picture) -> None:
    camera = make_camera(mirror, 97).with_picture(picture)
    centres = np.arange(97) + 0.5
    origins, directions, valid = rays_from_pixel_grid(camera, centres, centres)
    assert origins is not None
    pixels = np.stack(np.meshgrid(centres, centres), axis=-1)[valid]
    for distance_m in (0.05, 1.0, 100.0):
        points = (origins + distance_m * directions)[valid]
        found, shown = pixel_from_point(camera, points)
        # Rays of pixels next to the rim and to a cone's apex may leave it by rounding.
        assert shown.mean() > 0.999
        assert found[shown] == pytest.approx(pixels[shown], abs=1e-8)


@pytest.mark.parametrize("mirror", MIRRORS, ids=lambda mirror: type(mirror).__name__)
def test_error_of_the_approximation_falls_with_the_distance(mirror: NonCentralMirror) -> None:
    camera = make_camera(mirror, 360)
    theta = np.linspace(2.0 * math.atan(mirror.t_min), mirror.rim_rad, 50)[1:-1]
    direction = np.stack((np.sin(theta), np.zeros_like(theta), np.cos(theta)), axis=-1)
    at_infinity, _ = camera.pixel_from_direction(direction)
    for distance_m in (2.0, 20.0):
        pixel, valid = pixel_from_point(camera, distance_m * direction)
        error_px = np.linalg.norm(pixel - at_infinity, axis=-1)[valid].max()
        # To first order; the largest ring may lie beside the grid or beyond the rim.
        assert distance_m <= 1.02 * near_limit_m(camera, error_px)
        assert distance_m >= 0.8 * near_limit_m(camera, error_px)


@pytest.mark.parametrize("mirror", MIRRORS, ids=lambda mirror: type(mirror).__name__)
def test_ray_of_a_pixel_is_that_of_the_grid(mirror: NonCentralMirror) -> None:
    camera = make_camera(mirror, 61)
    centres = np.arange(61) + 0.5
    expected = rays_from_pixel_grid(camera, centres, centres)
    found = ray_from_pixel(camera, np.stack(np.meshgrid(centres, centres), axis=-1))
    for one, other in zip(found, expected, strict=True):
        assert other is not None
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12)


def test_ray_of_a_pixel_of_a_central_camera_begins_at_its_viewpoint() -> None:
    origin, direction, valid = ray_from_pixel(CENTRAL, np.array((40.0, 20.0)))
    assert valid
    assert not origin.any()
    assert direction == pytest.approx(CENTRAL.direction_from_pixel(np.array((40.0, 20.0)))[0])


def test_point_that_is_none_has_no_pixel() -> None:
    camera = make_camera(SphericalMirror(0.03, 0.2))
    points = np.array([[math.nan, 0.0, 1.0], [0.0, 0.0, -5.0], [math.inf, 0.0, 0.0]])
    pixel, valid = pixel_from_point(camera, points)
    assert not valid.any()
    assert pixel == pytest.approx(np.tile(camera.centre_px, (3, 1)))


WIDE_MIRRORS: list[NonCentralMirror] = [
    SphericalMirror(0.03, 0.2, math.radians(170.0)),
    SphericalMirror(0.03, 0.4, math.radians(175.0)),
    ConicalMirror(math.radians(20.0), 0.1, math.radians(150.0)),
]


@pytest.mark.parametrize("mirror", WIDE_MIRRORS, ids=lambda mirror: f"{mirror.rim_rad:.2f}")
def test_point_near_a_mirror_of_a_wide_rim_has_its_ray_s_pixel(mirror: NonCentralMirror) -> None:
    camera = make_camera(mirror, 33)
    pixels = np.stack(np.meshgrid(np.arange(33) + 0.5, np.arange(33) + 0.5), axis=-1)
    origins, directions, valid = ray_from_pixel(camera, pixels)
    for distance_m in (0.001, 0.01, 0.1):
        found, shown = pixel_from_point(camera, (origins + distance_m * directions)[valid])
        assert shown.all()
        assert found == pytest.approx(pixels[valid], abs=1e-9)


def test_point_is_shown_exactly_where_a_ray_passes_it() -> None:
    mirror = WIDE_MIRRORS[0]
    camera = make_camera(mirror, 97)
    rng = np.random.default_rng(38)
    # In the half plane of one azimuth, within and about the ball.
    points = rng.uniform((0.0, -0.15), (0.1, 0.1), (400, 2))
    t = np.tan(0.5 * np.linspace(0.0, mirror.rim_rad, 2001))
    surface = np.stack(mirror.surface_point(t), axis=-1)
    heading = np.stack((2.0 * t, (1.0 - t) * (1.0 + t)), axis=-1) / (1.0 + t * t)[:, None]
    offsets = points[:, None] - surface
    ahead = (offsets * heading).sum(axis=-1)
    beside = offsets[..., 0] * heading[:, 1] - offsets[..., 1] * heading[:, 0]
    # Two neighbouring rays have the point ahead and between them.
    passes = ((beside[:, 1:] * beside[:, :-1] <= 0.0) & (ahead[:, 1:] > 0.0)).any(axis=-1)
    _, shown = pixel_from_point(camera, np.insert(points, 1, 0.0, axis=1))
    # Points within the resolution of the rays of the mirror or of the rim's ray.
    is_near = (np.hypot(*np.moveaxis(offsets, -1, 0)) < 1e-4).any(axis=-1)
    assert (shown == passes)[~is_near].all()
    assert 0.05 < shown.mean() < 0.95


def test_point_on_the_axis_is_the_centre_of_a_ball_and_nowhere_on_a_cone() -> None:
    ball, _, cone = map(make_camera, MIRRORS)
    point = np.array([0.0, 0.0, 2.0])
    pixel, valid = pixel_from_point(ball, point)
    assert valid
    assert pixel == pytest.approx(ball.centre_px, abs=1e-9)
    assert not pixel_from_point(cone, point)[1]


def test_lens_has_a_viewpoint() -> None:
    camera = camera_with_inscribed_rim(EquidistantLens(), width_px=9, height_px=9, rim_rad=2.0)
    assert near_limit_m(camera) == 0.0
