"""Omnidirectional camera: pixels, directions, masks, handedness, extremes, OpenCV as reference."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import opencv_from_pixel, pixel_sample_positions
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, Mirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    direction_from_pixel,
    direction_from_pixel_grid,
    pixel_from_direction,
)

HYPERBOLIC = PAPER_MIRROR


def make_camera(
    mirror: Mirror = HYPERBOLIC,
    *,
    width_px: int = 360,
    height_px: int = 360,
    rim_deg: float = 120.0,
    up_azimuth_rad: float = 0.0,
) -> OmniCamera:
    return camera_with_inscribed_rim(
        mirror,
        width_px=width_px,
        height_px=height_px,
        rim_rad=math.radians(rim_deg),
        image_up_azimuth_rad=up_azimuth_rad,
    )


def direction_from_angles(incidence_deg: float, bearing_deg: float = 0.0) -> np.ndarray:
    theta, gamma = math.radians(incidence_deg), math.radians(bearing_deg)
    ring = math.sin(theta)
    return np.array([ring * math.cos(gamma), ring * math.sin(gamma), math.cos(theta)])


@pytest.mark.parametrize(
    ("rim_deg", "horizon_px"),
    [
        (100.0, 150.894),
        (110.0, 125.741),
        (120.0, 103.453),
        (math.degrees(math.pi - math.atan(math.sqrt(2.0))), 92.599),
        (135.0, 73.744),
        (150.0, 46.820),
    ],
)
def test_horizon_circle_when_the_rim_fills_360_px_is_that_of_the_table(
    rim_deg: float, horizon_px: float
) -> None:
    camera = make_camera(rim_deg=rim_deg)
    assert camera.horizon_radius_px == pytest.approx(horizon_px, abs=5.1e-4)
    assert camera.rim_radius_px == pytest.approx(180.0, abs=1e-12)


def test_rim_when_the_image_is_oblong_touches_the_nearer_borders() -> None:
    camera = make_camera(width_px=640, height_px=480)
    assert camera.centre_px == (320.0, 240.0)
    assert camera.rim_radius_px == pytest.approx(240.0, abs=1e-12)


@pytest.mark.parametrize(
    ("incidence_deg", "ratio"), [(20.0, 0.175941187), (90.0, 1.0), (110.0, 1.431515995)]
)
def test_pixel_when_of_an_incidence_lies_on_its_circle(incidence_deg: float, ratio: float) -> None:
    camera = make_camera()
    pixel, valid = pixel_from_direction(camera, direction_from_angles(incidence_deg, 37.0))
    assert valid
    radius = math.dist(pixel, camera.centre_px)
    assert radius / camera.scale_px == pytest.approx(ratio, abs=5.1e-10)


@pytest.mark.parametrize(
    ("bearing_deg", "u", "v"),
    [(0.0, 0.0, -1.0), (90.0, -1.0, 0.0), (-90.0, 1.0, 0.0), (180.0, 0.0, 1.0)],
    ids=["forward is up", "right is left", "left is right", "behind is down"],
)
def test_image_when_forward_is_up_is_mirrored(bearing_deg: float, u: float, v: float) -> None:
    camera = make_camera()
    pixel, _ = pixel_from_direction(camera, direction_from_angles(90.0, bearing_deg))
    away = (pixel - camera.centre_px) / camera.scale_px
    np.testing.assert_allclose(away, (u, v), atol=1e-15)


@pytest.mark.parametrize("up_deg", [0.0, 30.0, 90.0, 180.0, -135.0])
def test_image_when_turned_shows_the_up_azimuth_at_its_top(up_deg: float) -> None:
    camera = make_camera(up_azimuth_rad=math.radians(up_deg))
    pixel, _ = pixel_from_direction(camera, direction_from_angles(90.0, up_deg))
    expected = (180.0, 180.0 - camera.horizon_radius_px)
    np.testing.assert_allclose(pixel, expected, atol=1e-12)


def test_pixel_when_beside_the_mirror_is_invalid_and_harmless() -> None:
    camera = make_camera()
    pixel = np.array([[0.5, 0.5], [180.0, -1e9], [1e300, 1e300], [math.nan, 1.0], [math.inf, 0.0]])
    there, valid = direction_from_pixel(camera, pixel)
    assert not valid.any()
    np.testing.assert_array_equal(there, np.tile([0.0, 0.0, 1.0], (5, 1)))


@pytest.mark.parametrize("mirror", [HYPERBOLIC, ParabolicMirror(0.05)])
@pytest.mark.parametrize(
    ("centre_px", "up_azimuth_rad"),
    [((20.0, 15.0), 0.0), ((20.0, 15.0), 0.3), ((17.3, 15.0), 2.0), ((-3.0, 31.7), 0.0)],
)
def test_direction_in_a_grid_is_that_of_its_pixel_to_the_last_bit(
    mirror: Mirror, centre_px: tuple[float, float], up_azimuth_rad: float
) -> None:
    inscribed = make_camera(mirror, width_px=40, height_px=30, up_azimuth_rad=up_azimuth_rad)
    camera = dataclasses.replace(inscribed, centre_px=centre_px)
    # Far outside too, where the distance from the centre has no finite square.
    u = np.concatenate((np.arange(0.25, 40.0, 0.5), [-1e3, 1e200, -1.7e308]))
    v = np.concatenate((np.arange(0.25, 30.0, 0.5), [1e3, -1e200, 1.7e308]))
    direction, valid = direction_from_pixel_grid(camera, u, v)
    expected, expected_valid = direction_from_pixel(camera, np.stack(np.meshgrid(u, v), axis=-1))
    np.testing.assert_array_equal(valid, expected_valid)
    assert direction[valid].tobytes() == expected[valid].tobytes()
    np.testing.assert_array_equal(direction, expected)
    assert 0 < valid.sum() < valid.size


def test_mask_when_over_the_whole_image_is_the_rim_s_disc() -> None:
    camera = make_camera()
    centres = pixel_sample_positions(camera)[:, :, 0]
    _, valid = direction_from_pixel(camera, centres)
    inside = np.hypot(*(centres - 180.0).T).T < 180.0
    np.testing.assert_array_equal(valid, inside)


@pytest.mark.parametrize(
    "unseen",
    [
        direction_from_angles(121.0, 45.0),
        direction_from_angles(179.99999),
        np.array([0.0, 0.0, -1.0]),
        np.array([0.0, 0.0, 0.0]),
        np.array([math.nan, 0.0, 1.0]),
        np.array([math.inf, 0.0, 1.0]),
    ],
    ids=["beyond the rim", "near the antipode", "antipode", "zero", "nan", "infinite"],
)
def test_direction_when_not_visible_is_invalid_and_at_the_centre(unseen: np.ndarray) -> None:
    pixel, valid = pixel_from_direction(make_camera(), unseen)
    assert not valid
    np.testing.assert_array_equal(pixel, (180.0, 180.0))


@pytest.mark.parametrize(("beyond_rad", "seen"), [(-1e-12, True), (1e-12, False)])
def test_direction_when_just_inside_the_rim_is_visible(beyond_rad: float, seen: bool) -> None:
    theta = math.radians(120.0) + beyond_rad
    _, valid = pixel_from_direction(
        make_camera(), np.array([math.sin(theta), 0.0, math.cos(theta)])
    )
    assert bool(valid) is seen


def test_projection_agrees_with_opencv_s_omnidirectional_model() -> None:
    """This mirror is Mei's model with xi and gamma = h xi, seen mirrored."""
    camera = make_camera(width_px=640, height_px=480)
    there = np.array(
        [direction_from_angles(t, g) for t in (5, 45, 90, 118) for g in range(0, 360, 25)]
    )
    mirrored = np.stack((-there[:, 1], -there[:, 0], there[:, 2]), axis=-1)
    gamma = camera.horizon_radius_px * HYPERBOLIC.xi
    matrix = np.array([[gamma, 0, 319.5], [0, gamma, 239.5], [0, 0, 1.0]])
    still = np.zeros((3, 1))
    opencv_pixel, _ = cv2.omnidir.projectPoints(
        mirrored.reshape(-1, 1, 3), still, still, matrix, HYPERBOLIC.xi, np.zeros((1, 4))
    )
    pixel, _ = pixel_from_direction(camera, there)
    np.testing.assert_allclose(opencv_from_pixel(pixel), opencv_pixel.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"width_px": 0}, "no pixel"),
        ({"height_px": -1}, "no pixel"),
        ({"scale_px": 0.0}, "radius > 0"),
        ({"scale_px": math.nan}, "radius > 0"),
        ({"rim_rad": 0.0}, "below 155.405"),
        ({"rim_rad": math.radians(155.41)}, "below 155.405"),
        ({"rim_rad": math.pi}, "below 155.405"),
        ({"rim_rad": math.nan}, "below 155.405"),
    ],
)
def test_camera_when_impossible_is_rejected(change: dict[str, float], expected: str) -> None:
    values = {
        "width_px": 360,
        "height_px": 360,
        "centre_px": (180.0, 180.0),
        "scale_px": 100.0,
        "rim_rad": 2.0,
    }
    with pytest.raises(DomainError, match=expected):
        OmniCamera(HYPERBOLIC, **{**values, **change})  # type: ignore[arg-type] # by name
