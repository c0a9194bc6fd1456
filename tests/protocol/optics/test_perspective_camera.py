"""Perspective camera: validity, and the round trip through the inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera

CAMERA = PerspectiveCamera(320, 240, math.radians(80.0))


def test_axis_is_the_image_centre_exactly_and_the_image_is_not_mirrored() -> None:
    pixel, valid = CAMERA.pixel_from_direction(
        np.array([[2.0, 0.0, 0.0], [1.0, 0.1, 0.0], [1.0, 0.0, 0.1]])
    )
    assert valid.all()
    assert pixel[0].tolist() == [160.0, 120.0]
    assert pixel[1, 0] > 160.0, "what is right of the camera is right in the picture"
    assert pixel[2, 1] > 120.0, "what is below is below"


def test_field_of_view_is_the_image_width() -> None:
    pixel, valid = CAMERA.pixel_from_direction(
        np.array([[math.cos(half), math.sin(half), 0.0] for half in np.radians([-39.999, 39.999])])
    )
    assert valid.all()
    # A thousandth of a degree at the border is 0.006 px.
    np.testing.assert_allclose(pixel[:, 0], [0.0, 320.0], atol=0.01)


@pytest.mark.parametrize("fov_deg", [0.1, 1.0, 60.0, 90.0, 120.0, 179.0])
@pytest.mark.parametrize("size", [(1, 1), (320, 240), (101, 733)])
def test_inverse_returns_to_every_pixel(fov_deg: float, size: tuple[int, int]) -> None:
    camera = PerspectiveCamera(*size, math.radians(fov_deg))
    pixel = pixel_sample_positions(camera, 1)[::7, ::7]
    direction, valid = camera.direction_from_pixel(pixel)
    back, is_visible = camera.pixel_from_direction(direction)
    assert valid.all()
    assert is_visible.all()
    np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1.0, rtol=1e-14)
    # A unit vector near the border of 179 degrees has an x of a hundredth: eps 733 px / 0.01.
    np.testing.assert_allclose(back, pixel, atol=1e-9)


@pytest.mark.parametrize(
    "direction",
    [
        (0.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (-1.0, 0.0, 0.0),
        (-1.0, 0.1, 0.1),
        (1e-320, 1.0, 0.0),
        (1.0, 1.0, 0.0),
        (1.0, 0.0, 1.0),
        (math.nan, 0.0, 0.0),
        (math.inf, 0.0, 0.0),
    ],
)
def test_direction_beside_the_image_is_invalid_and_has_a_value(
    direction: tuple[float, float, float],
) -> None:
    pixel, valid = CAMERA.pixel_from_direction(np.array(direction))
    assert not valid
    assert pixel.tolist() == [160.0, 120.0]


@pytest.mark.parametrize(
    ("pixel", "inside"),
    [
        ((0.0, 0.0), True),
        ((320.0, 240.0), True),
        ((-1e-9, 5.0), False),
        ((5.0, 240.0000001), False),
        ((math.nan, 5.0), False),
        ((math.inf, 5.0), False),
    ],
)
def test_pixel_is_valid_within_the_image_borders_included(
    pixel: tuple[float, float], inside: bool
) -> None:
    direction, valid = CAMERA.direction_from_pixel(np.array(pixel))
    assert bool(valid) is inside
    assert inside or direction.tolist() == [1.0, 0.0, 0.0]


def test_image_without_pixels_is_rejected() -> None:
    with pytest.raises(DomainError, match="no pixel"):
        PerspectiveCamera(0, 10, 1.0)
