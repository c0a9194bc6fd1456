"""Pixels of points, and visibility of moved ones; the flow as a whole is in test_label_renderer."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.frames.labels.label_renderer import project_points
from helpers.labelled_rooms import CAMERAS


@pytest.mark.parametrize("name", CAMERAS)
def test_points_on_rays_have_the_pixels_of_the_rays(name: str) -> None:
    camera = CAMERAS[name]
    rng = np.random.default_rng(3)
    pixels = rng.uniform(8.0, 88.0, (200, 2))
    origins, directions, valid = ray_from_pixel(camera, pixels)
    points = origins + rng.uniform(0.3, 20.0, (200, 1)) * directions
    found, shown = project_points(camera, points)
    assert valid.sum() > 100
    assert shown[valid].all()
    np.testing.assert_allclose(found[valid], pixels[valid], atol=2e-3)


def test_points_beside_the_image_are_invalid() -> None:
    camera = PerspectiveCamera(64, 48, 1.0)
    _, shown = project_points(
        camera, np.array(((1.0, 0.0, 0.0), (1.0, 2.0, 0.0), (-1.0, 0.0, 0.0)))
    )
    assert shown.tolist() == [True, False, False]


def test_points_near_a_mirror_without_a_viewpoint_have_the_pixels_of_the_exact_root() -> None:
    camera = CAMERAS["ball"]
    rng = np.random.default_rng(5)
    pixels = rng.uniform(8.0, 88.0, (400, 2))
    origins, directions, valid = ray_from_pixel(camera, pixels)
    points = (origins + rng.uniform(0.15, 0.4, (400, 1)) * directions)[valid]
    found, shown = project_points(camera, points)
    expected, _ = pixel_from_point(camera, points)
    assert shown.all()
    np.testing.assert_allclose(found, expected, atol=2e-3)
