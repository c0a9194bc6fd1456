"""Sigmas of range and bearing against the table of optics.md 4, and the move to the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.landmarks.detection import (
    Sighting,
    azimuth_sigma,
    bearing_detection,
    detection,
    range_sigma,
)
from catoptra_client.landmarks.viewpoint import Viewpoint
from catoptra_protocol.optics.camera import pixel_from_direction
from client.landmarks import synthetic

SIGHTING = Sighting(2.0, 0.5, 0.1, 0.01)


@pytest.mark.parametrize(
    ("range_m", "sigma_mm"), [(0.5, 9.0), (2.0, 45.0), (3.0, 90.0), (5.0, 229.0)]
)
def test_sigma_of_a_foot_point_equals_the_table(range_m: float, sigma_mm: float) -> None:
    sigma = range_sigma(synthetic.camera(), drop_m=0.6, range_m=range_m, sigma_px=0.5)
    # The table is rounded to millimetres and takes the slope of Eq. 2, 0.5 % off near the horizon.
    assert 1000 * sigma == pytest.approx(sigma_mm, rel=0.006, abs=0.6)


@pytest.mark.parametrize("drop_m", [0.6, 0.25, 1e-3, -0.4])
@pytest.mark.parametrize("range_m", [0.8, 1.5, 4.0])
def test_sigmas_equal_half_a_pixel_moved_in_the_image(drop_m: float, range_m: float) -> None:
    camera, step = synthetic.camera(), 1e-5

    def radius(r: float) -> float:
        pixel, _ = pixel_from_direction(camera, np.array([r, 0.0, drop_m]))
        return float(np.hypot(*(pixel - camera.centre_px)))

    pixels_per_metre = (radius(range_m + step) - radius(range_m - step)) / (2 * step)
    along = range_sigma(camera, drop_m=drop_m, range_m=range_m, sigma_px=0.5)
    across = azimuth_sigma(camera, drop_m=drop_m, range_m=range_m, sigma_px=0.5)
    assert along == pytest.approx(0.5 / pixels_per_metre * math.copysign(1.0, drop_m), rel=1e-5)
    assert across == pytest.approx(0.5 / radius(range_m), rel=1e-9)


def test_detection_without_an_offset_keeps_the_sighting() -> None:
    seen = detection("l", "beacon", SIGHTING, viewpoint=Viewpoint(), pixels=9)
    assert (seen.range_m, seen.bearing_rad, seen.has_range) == (2.0, 0.5, True)
    np.testing.assert_allclose(seen.covariance, np.diag([0.01, 0.0001]))


def test_detection_with_an_offset_mixes_range_and_bearing() -> None:
    seen = detection("l", "beacon", SIGHTING, viewpoint=Viewpoint(0.6, 0.0, 0.5), pixels=9)
    assert seen.covariance[0, 1] != 0.0
    assert np.linalg.eigvalsh(seen.covariance)[0] > 0.0


def test_bearing_alone_promises_no_range() -> None:
    seen = bearing_detection("g", "goal", SIGHTING, viewpoint=Viewpoint(), pixels=9)
    assert (seen.range_m, seen.has_range) == (0.0, False)
    np.testing.assert_allclose(seen.covariance, np.diag([0.0, 0.0001]))


def test_bearing_alone_seen_off_centre_is_less_sure() -> None:
    vague = Sighting(2.0, 0.5, 1.0, 0.01)
    seen = bearing_detection("g", "goal", vague, viewpoint=Viewpoint(0.6, 0.0, 0.3), pixels=9)
    assert seen.covariance[1, 1] > 0.0002
