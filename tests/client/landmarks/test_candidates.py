"""From blobs to candidates, ranges and detections."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_client.landmarks.blobs import Blob, Viewpoint
from catoptra_client.landmarks.candidates import (
    Candidate,
    CylinderView,
    Detection,
    PolarMeasurement,
    detection_from_candidate,
    is_clear_of_horizon,
    range_from_half_angle,
    range_from_slope,
    range_sigma_from_angle,
    require_distinct_colours,
)
from catoptra_client.landmarks.detector import DEFAULT_CYLINDER
from catoptra_protocol.errors import DomainError
from client.landmarks import synthetic_frames


@pytest.mark.parametrize("drop_m", [0.6, -0.6])
def test_horizon_and_the_wrong_side_of_it_have_no_range(drop_m: float) -> None:
    assert range_from_slope(0.0, drop_m=drop_m) == (0.0, False)
    assert range_from_slope(-drop_m, drop_m=drop_m) == (0.0, False)
    assert range_from_half_angle(1.0, drop_m=drop_m) == (0.0, False)
    assert range_from_half_angle(1.0 + 0.1 * drop_m, drop_m=drop_m) == (0.0, False)


def test_tiny_slope_and_drop_on_the_same_side_still_have_a_range() -> None:
    assert range_from_slope(1e-200, drop_m=1e-200) == (1.0, True)
    assert range_from_slope(1e-300, drop_m=1e300) == (0.0, False)


def test_level_point_has_no_range_sigma_but_one_of_its_azimuth() -> None:
    camera = synthetic_frames.make_camera()
    view = CylinderView(camera, DEFAULT_CYLINDER, Viewpoint())
    down_rad, azimuth_rad, _, valid = view.angle_sigmas(0.3, drop_m=0.0, range_m=2.0, sigma_px=0.5)
    assert valid
    assert range_sigma_from_angle(drop_m=0.0, range_m=2.0, sigma_rad=down_rad) == (0.0, False)
    assert azimuth_rad == pytest.approx(0.5 / camera.horizon_radius_px, rel=1e-12)


def test_sigmas_of_a_turned_camera_are_those_of_its_pixels() -> None:
    camera = synthetic_frames.make_camera()
    view = CylinderView(camera, DEFAULT_CYLINDER, Viewpoint(rpy_rad=(0.3, -0.2, 0.1)))
    down_rad, azimuth_rad, correlation, valid = view.angle_sigmas(
        0.7, drop_m=0.6, range_m=1.5, sigma_px=0.01
    )
    rotation = view.viewpoint.rotation
    assert valid
    point = np.array((1.5 * math.cos(0.7), 1.5 * math.sin(0.7), 0.6))
    pixel, _ = camera.pixel_from_direction(point @ rotation)
    noise = np.random.default_rng(1).normal(0.0, 0.01, (20000, 2))
    x, y, z = (camera.direction_from_pixel(pixel + noise)[0] @ rotation.T).T
    found = np.stack((np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)))
    covariance = np.cov(found)
    assert covariance[0, 0] == pytest.approx(down_rad**2, rel=0.04)
    assert covariance[1, 1] == pytest.approx(azimuth_rad**2, rel=0.04)
    assert covariance[0, 1] == pytest.approx(
        correlation * down_rad * azimuth_rad, abs=0.02 * down_rad * azimuth_rad
    )


@pytest.mark.parametrize(("degrees", "clear"), [(2.9, False), (3.1, True)])
def test_three_sigma_off_the_horizon_are_clear_of_it(degrees: float, clear: bool) -> None:
    drop_m = 10.0 * math.tan(math.radians(degrees))
    for sign in (1.0, -1.0):
        place = {"drop_m": sign * drop_m, "range_m": 10.0, "sigma_rad": math.radians(1.0)}
        assert is_clear_of_horizon(**place) == clear


BEACON = next(row for row in synthetic_frames.FIELD_LANDMARKS if row.kind == "beacon")
BLOB = Blob("yellow", 9, 1.0, 1.0, 0.0, 3.0, 0.0, 3.0)


def detect_at(viewpoint: Viewpoint, *, has_range: bool, range_sigma_m: float = 0.1) -> Detection:
    """Detection of a beacon 2 m away at 0.5 rad, seen from a viewpoint."""
    measurement = PolarMeasurement(2.0, 0.5, range_sigma_m, 0.01)
    candidate = Candidate(BEACON, (BLOB,), measurement, has_range)
    return detection_from_candidate(candidate, viewpoint)


def test_detection_without_an_offset_keeps_the_measurement() -> None:
    seen = detect_at(Viewpoint(), has_range=True)
    assert (seen.range_m, seen.bearing_rad, seen.has_range) == (2.0, 0.5, True)
    assert (seen.name, seen.kind, seen.num_pixels) == (BEACON.name, "beacon", 9)
    np.testing.assert_allclose(seen.covariance, np.diag([0.01, 0.0001]))


def test_detection_with_an_offset_mixes_range_and_bearing() -> None:
    seen = detect_at(Viewpoint(0.6, 0.0, 0.5), has_range=True)
    assert seen.covariance[0, 1] != 0.0
    assert np.linalg.eigvalsh(seen.covariance)[0] > 0.0


def test_bearing_alone_promises_no_range() -> None:
    seen = detect_at(Viewpoint(), has_range=False)
    assert (seen.range_m, seen.has_range) == (0.0, False)
    np.testing.assert_allclose(seen.covariance, np.diag([0.0, 0.0001]))


def test_bearing_alone_seen_off_centre_is_less_sure() -> None:
    seen = detect_at(Viewpoint(0.6, 0.0, 0.3), has_range=False, range_sigma_m=1.0)
    assert seen.covariance[1, 1] > 0.0002


VIEW = CylinderView(synthetic_frames.make_camera(), DEFAULT_CYLINDER, Viewpoint())


def test_columns_beyond_the_image_continue_around() -> None:
    assert VIEW.azimuth_from_column(0.0) == pytest.approx(math.pi)
    assert VIEW.azimuth_from_column(730.0) == pytest.approx(-math.pi + 10 * math.pi / 360)


def test_drop_is_measured_from_the_viewpoint_to_a_fraction_of_the_band() -> None:
    assert [VIEW.drop_m(BEACON, share) for share in (0.0, 0.5, 1.0)] == pytest.approx(
        [0.4, 0.3, 0.2]
    )


@pytest.mark.parametrize(
    ("top", "bottom", "cut"), [(0, 5, True), (170, 180, True), (1, 179, False)]
)
def test_blob_at_an_edge_is_cut(top: float, bottom: float, cut: bool) -> None:
    blob = Blob("cyan", 9, 5.0, 0.5 * (top + bottom), 2, 8, top, bottom)
    assert VIEW.touches_edge(blob) == cut


def test_landmarks_of_equal_appearance_are_rejected() -> None:
    twin = dataclasses.replace(BEACON, name="twin", x_m=0.0)
    with pytest.raises(DomainError, match=r"twin and .* do not distinguish them"):
        require_distinct_colours([BEACON, twin])


def test_beacon_of_one_colour_is_rejected() -> None:
    plain = dataclasses.replace(BEACON, upper_colour=BEACON.lower_colour)
    with pytest.raises(DomainError, match="one colour"):
        require_distinct_colours([plain])


def test_field_landmarks_have_distinct_colours() -> None:
    require_distinct_colours(synthetic_frames.FIELD_LANDMARKS)
