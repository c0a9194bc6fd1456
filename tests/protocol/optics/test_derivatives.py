"""Derivatives of pixels and rays; against 40 digits in `tests/stability/references/jacobian.py`."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.derivatives import (
    differentiate_direction,
    differentiate_point,
    differentiate_ray,
    parameter_names,
)
from catoptra_protocol.optics.lenses import EquidistantLens, RadialTableLens
from catoptra_protocol.optics.mirrors import (
    PAPER_MIRROR,
    ConicalMirror,
    EquiangularMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection
from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy


def make_camera(projection: RadialProjection) -> OmniCamera:
    return camera_with_inscribed_rim(
        projection,
        width_px=200,
        height_px=200,
        rim_rad=getattr(projection, "rim_rad", 2.0),
        image_up_azimuth_rad=0.4,
    )


MIRRORS = [
    PAPER_MIRROR,
    SphericalMirror(0.03, 0.4, math.radians(175.0)),
    EquiangularMirror(11.0, 0.1),
    ConicalMirror(math.radians(60.0), 0.1, math.radians(88.0)),
]
CAMERAS = [make_camera(mirror).with_picture(picture) for mirror in MIRRORS for picture in Picture]
IDS = [f"{type(one.projection).__name__}-{one.picture}" for one in CAMERAS]
# Pixels between the apex of the cone and the rim.
PIXELS = np.array(((160.0, 120.0), (60.0, 130.0), (95.0, 30.0)))


@pytest.mark.parametrize("camera", CAMERAS, ids=IDS)
@pytest.mark.parametrize("distance_m", [0.002, 3.0])
def test_pixel_of_a_point_changes_by_its_derivatives(camera, distance_m: float) -> None:
    origin, direction, _ = ray_from_pixel(camera, PIXELS)
    point = origin + distance_m * direction
    found = differentiate_point(camera, point)
    assert found.valid.all()
    step_m = 1e-5 * distance_m
    expected = [
        (pixel_from_point(camera, point + step)[0] - pixel_from_point(camera, point - step)[0])
        / (2.0 * step_m)
        for step in step_m * np.eye(3)
    ]
    scale = np.abs(found.by_point).max()
    np.testing.assert_allclose(found.by_point, np.stack(expected, axis=-1), atol=1e-8 * scale)


@pytest.mark.parametrize("camera", CAMERAS, ids=IDS)
def test_ray_of_a_pixel_changes_by_its_derivatives(camera) -> None:
    found = differentiate_ray(camera, PIXELS)
    assert found.valid.all()
    for index, of in enumerate((found.origin_by_pixel, found.by_pixel)):
        expected = [
            (
                ray_from_pixel(camera, PIXELS + step)[index]
                - ray_from_pixel(camera, PIXELS - step)[index]
            )
            / 2e-4
            for step in 1e-4 * np.eye(2)
        ]
        # Differences of float64 numbers have no more digits.
        np.testing.assert_allclose(of, np.stack(expected, axis=-1), atol=1e-9)


def test_pixel_of_a_point_changes_with_the_pose_of_the_camera() -> None:
    camera = make_camera(PAPER_MIRROR)
    point = np.array((0.7, -0.4, 0.2))
    by_pose = differentiate_point(camera, point).by_pose

    def see(step: Floats) -> Floats:
        moved = Pose(rotation_from_rpy(step[3], step[4], step[5]), step[:3])
        return pixel_from_point(camera, moved.inverse().transform_points(point[None]))[0][0]

    expected = [(see(step) - see(-step)) / 2e-5 for step in 1e-5 * np.eye(6)]
    np.testing.assert_allclose(by_pose, np.stack(expected, axis=-1), rtol=1e-7, atol=1e-5)


def test_radii_of_a_table_have_derivatives() -> None:
    lens = RadialTableLens((0.0, 40.0, 80.0, 160.0), (0.0, 110.0, 200.0, 400.0))
    camera = make_camera(EquidistantLens())
    camera = replace(camera, projection=lens, scale_px=0.2, rim_rad=2.0)
    direction = np.array((0.8, 0.1, 0.3))
    found = differentiate_direction(camera, direction).by_parameters
    assert parameter_names(camera)[-3:] == ("radii_1", "radii_2", "radii_3")
    for index in range(1, 4):
        shifted = []
        for step in (1e-3, -1e-3):
            radii = tuple(r + step * (i == index) for i, r in enumerate(lens.radii))
            bent = replace(camera, projection=replace(lens, radii=radii))
            shifted.append(bent.pixel_from_direction(direction)[0])
        expected = (shifted[0] - shifted[1]) / 2e-3
        np.testing.assert_allclose(found[:, 9 + index], expected, atol=1e-9)


FLAT = PerspectiveCamera(640, 480, math.radians(75.0))


def test_pixels_and_rays_of_a_flat_image_change_by_their_derivatives() -> None:
    point = np.array(((2.0, 0.3, -0.4), (0.5, -0.2, 0.1), (1.0, 0.0, 0.0)))
    found = differentiate_point(FLAT, point)
    ray = differentiate_ray(FLAT, found.pixel)
    assert found.valid.all()
    assert ray.valid.all()

    def see(step: Floats) -> Floats:
        moved = Pose(rotation_from_rpy(step[3], step[4], step[5]), step[:3])
        return FLAT.pixel_from_direction(moved.inverse().transform_points(point))[0]

    steps = 1e-6 * np.eye(6)
    by_pose = np.stack([(see(step) - see(-step)) / 2e-6 for step in steps], axis=-1)
    np.testing.assert_allclose(found.by_pose, by_pose, atol=1e-6)
    np.testing.assert_array_equal(found.by_point, -found.by_pose[..., :3])
    same = differentiate_direction(FLAT, point)
    np.testing.assert_array_equal(same.by_point, found.by_point)
    turns = [
        FLAT.direction_from_pixel(found.pixel + step)[0]
        - FLAT.direction_from_pixel(found.pixel - step)[0]
        for step in 1e-3 * np.eye(2)
    ]
    np.testing.assert_allclose(ray.by_pixel, np.stack(turns, axis=-1) / 2e-3, atol=1e-11)
    assert parameter_names(FLAT) == ("horizontal_fov_rad",)
    wide, narrow = (
        replace(FLAT, horizontal_fov_rad=FLAT.horizontal_fov_rad + step) for step in (1e-6, -1e-6)
    )
    for of, by_fov in (
        (lambda one: one.pixel_from_direction(point)[0], found.by_parameters),
        (lambda one: one.direction_from_pixel(found.pixel)[0], ray.by_parameters),
    ):
        np.testing.assert_allclose(by_fov[..., 0], (of(wide) - of(narrow)) / 2e-6, atol=1e-6)


def test_outside_a_flat_image_derivatives_are_0_and_invalid() -> None:
    for direction in ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (math.nan, 0.0, 1.0)):
        found = differentiate_direction(FLAT, np.array(direction))
        assert not found.valid
        assert not found.by_point.any()
        assert not found.by_pose.any()
        assert not found.by_parameters.any()
    for pixel in ((-1.0, 3.0), (math.inf, 3.0), (math.nan, 3.0)):
        ray = differentiate_ray(FLAT, np.array(pixel))
        assert not ray.valid
        assert not ray.by_pixel.any()
        assert not ray.by_parameters.any()


def test_outside_the_domain_derivatives_are_0_and_invalid() -> None:
    camera = make_camera(PAPER_MIRROR)
    for direction in ((0.0, 0.0, -1.0), (math.nan, 0.0, 1.0), (0.0, 0.0, 0.0)):
        found = differentiate_point(camera, np.array(direction))
        assert not found.valid
        assert not found.by_point.any()
        assert not found.by_parameters.any()
    ray = differentiate_ray(camera, np.array((-50.0, math.inf)))
    assert not ray.valid
    assert not ray.by_pixel.any()
