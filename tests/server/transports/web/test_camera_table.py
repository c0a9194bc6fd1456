"""The table of a camera against the camera model itself."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import EquidistantLens, UnifiedLens
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, ConicalMirror, Mirror, SphericalMirror
from catoptra_protocol.optics.mirrors.parabolic import ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    pixel_from_direction,
)
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.serve.web.pages import camera_table

# What the page may miss: a hundredth of what is seen, and more than interpolation costs.
TOLERANCE_PX = 1e-4


def pixel_from_table(table: dict[str, Any], theta_rad: Floats, phi_rad: Floats) -> Floats:
    """Pixels (..., 2) as the page computes them."""
    a, b, c, d = table["azimuth_matrix"]
    thetas = np.linspace(0.0, table["max_theta_rad"], len(table["radius_px"]))
    radius = np.interp(theta_rad, thetas, table["radius_px"])
    x, y = np.cos(phi_rad), np.sin(phi_rad)
    u, v = table["centre_px"]
    pixel = np.stack((u + radius * (a * x + b * y), v + radius * (c * x + d * y)), axis=-1)
    if "decentring_px" in table:
        squared = np.interp(theta_rad, thetas, table["decentring_px"])
        matrix = np.reshape(table["decentring_matrix"], (2, 3))
        pixel += squared[..., None] * (np.stack((x * x, x * y, y * y), axis=-1) @ matrix.T)
    return pixel


def make_camera(mirror: Mirror, *, up_rad: float, is_cropped: bool) -> OmniCamera:
    if not is_cropped:
        return camera_with_inscribed_rim(
            mirror,
            width_px=640,
            height_px=640,
            rim_rad=math.radians(110.0),
            image_up_azimuth_rad=up_rad,
        )
    return OmniCamera(mirror, 640, 480, (301.5, 222.25), 190.0, math.radians(115.0), up_rad)


@pytest.mark.parametrize(
    "mirror", [PAPER_MIRROR, ParabolicMirror(0.5)], ids=["hyperbolic", "parabolic"]
)
@pytest.mark.parametrize("up_rad", [0.0, 0.5 * math.pi, -2.0])
@pytest.mark.parametrize("is_cropped", [False, True])
def test_pixels_of_the_table_are_those_of_the_model(
    mirror: Mirror, up_rad: float, is_cropped: bool
) -> None:
    camera = make_camera(mirror, up_rad=up_rad, is_cropped=is_cropped)
    theta, phi = np.meshgrid(
        np.linspace(0.0, camera.rim_rad, 1237), np.linspace(-math.pi, math.pi, 37)
    )
    direction = np.stack(
        (np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    expected, valid = pixel_from_direction(camera, direction)
    # The rim itself may round to either side.
    assert valid[:, :-1].all()
    table = camera_table(camera)
    difference = np.abs(pixel_from_table(table, theta, phi) - expected)[valid]
    assert difference.max() < TOLERANCE_PX


def test_table_states_image_and_domain() -> None:
    camera = make_camera(PAPER_MIRROR, up_rad=0.0, is_cropped=True)
    table = camera_table(camera)
    assert table["kind"] == "radial"
    assert (table["width_px"], table["height_px"]) == (640, 480)
    assert table["picture"] == "mirrored"
    assert table["centre_px"] == (301.5, 222.25)
    assert table["min_theta_rad"] == 0.0
    assert table["max_theta_rad"] == camera.rim_rad
    radius_px = table["radius_px"]
    assert isinstance(radius_px, list)
    assert len(radius_px) == 4096
    assert radius_px[0] == 0.0
    assert radius_px[-1] == pytest.approx(camera.rim_radius_px, abs=1e-9)
    assert np.all(np.diff(radius_px) > 0.0)


@pytest.mark.parametrize("picture", list(Picture))
def test_table_of_a_stretched_lens_gives_its_pixels(picture: Picture) -> None:
    plane = ImagePlane((1.0, 0.01, 0.0, 1.02))
    lens = EquidistantLens()
    camera = OmniCamera(lens, 640, 480, (310.0, 250.0), 120.0, math.pi, 0.4, picture, plane)
    assert_table_projects(camera, np.radians([1.0, 45.0, 90.0, 170.0]))


@pytest.mark.parametrize("picture", list(Picture))
def test_table_of_a_decentred_lens_gives_its_pixels(picture: Picture) -> None:
    # Ten times the tangential distortion of a published fish-eye: it moves the rim by 3.5 px.
    plane = ImagePlane((1.0, 0.01, 0.0, 1.02), p1=4e-3, p2=-3e-3)
    lens = UnifiedLens(2.2, 0.0168, 1.65)
    camera = OmniCamera(lens, 1400, 1400, (710.0, 690.0), 1336.0, 1.6, 0.4, picture, plane)
    radial = replace(camera, plane=replace(plane, p1=0.0, p2=0.0))
    assert "decentring_px" not in camera_table(radial)
    theta_rad = np.array([0.01, 0.5, 1.0, 1.6])
    assert_table_projects(camera, theta_rad)
    displaced = [pixels_of_model(one, theta_rad, 1.0) for one in (camera, radial)]
    assert np.abs(displaced[0] - displaced[1])[-1].max() > 3.0


def test_table_of_a_cone_begins_at_its_apex() -> None:
    cone = ConicalMirror(math.radians(60.0), 0.1, math.radians(88.0))
    camera = camera_with_inscribed_rim(cone, width_px=360, height_px=360, rim_rad=cone.rim_rad)
    assert_table_projects(camera, np.radians([61.0, 75.0, 87.0]))
    assert camera_table(camera)["min_theta_rad"] == pytest.approx(math.radians(60.0))


def test_table_of_a_ball_states_where_its_rays_begin() -> None:
    ball = SphericalMirror(0.03, 0.2, math.radians(120.0))
    camera = camera_with_inscribed_rim(ball, width_px=360, height_px=360, rim_rad=ball.rim_rad)
    table: Any = camera_table(camera)
    pixels = np.array([(180.5, 180.0), (200.0, 300.0), (40.0, 100.0)])
    origins, directions, valid = ray_from_pixel(camera, pixels)
    assert valid.all()
    x, y, z = directions.T
    thetas = np.linspace(0.0, table["max_theta_rad"], len(table["surface_r_m"]))
    theta_rad = np.arctan2(np.hypot(x, y), z)
    r, depth = (np.interp(theta_rad, thetas, table[f"surface_{name}_m"]) for name in "rz")
    assert r == pytest.approx(np.hypot(origins[:, 0], origins[:, 1]), abs=1e-8)
    assert depth == pytest.approx(origins[:, 2], abs=1e-8)


def test_table_of_a_camera_with_a_viewpoint_has_no_surface() -> None:
    camera = make_camera(PAPER_MIRROR, up_rad=0.0, is_cropped=False)
    assert "surface_r_m" not in camera_table(camera)
    ball = SphericalMirror(0.03, 0.2, math.radians(120.0))
    exact = camera_with_inscribed_rim(ball, width_px=360, height_px=360, rim_rad=ball.rim_rad)
    assert "surface_r_m" not in camera_table(replace(exact, is_approximated=True))


def assert_table_projects(camera: OmniCamera, theta_rad: Floats) -> None:
    """Check pixels by the table against the model's."""
    table: Any = camera_table(camera)
    for azimuth in (0.0, 1.0, -2.5):
        found = pixel_from_table(table, theta_rad, np.full_like(theta_rad, azimuth))
        assert found == pytest.approx(pixels_of_model(camera, theta_rad, azimuth), abs=1e-3)


def pixels_of_model(camera: OmniCamera, theta_rad: Floats, azimuth_rad: float) -> Floats:
    """Pixels (n, 2) of the camera model at (n,) incidence angles."""
    sine = np.sin(theta_rad)
    x, y = math.cos(azimuth_rad), math.sin(azimuth_rad)
    direction = np.stack((sine * x, sine * y, np.cos(theta_rad)), axis=-1)
    pixels, valid = pixel_from_direction(camera, direction)
    assert valid.all()
    return pixels
