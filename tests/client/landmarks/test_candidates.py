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
    level_detection,
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


def tilt(vector: tuple[float, float, float], roll: float, pitch: float) -> np.ndarray:
    """Level axes of a vector on the robot: turned about x, then about y."""
    x, y, z = vector
    y, z = y * math.cos(roll) - z * math.sin(roll), y * math.sin(roll) + z * math.cos(roll)
    return np.array((x * math.cos(pitch) + z * math.sin(pitch), y,
                     z * math.cos(pitch) - x * math.sin(pitch)))  # fmt: skip


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.3, 0.0), (0.0, -0.4), (-0.2, 0.35)])
@pytest.mark.parametrize("azimuth", [0.0, 1.0, 2.5, -2.0, -0.7])
@pytest.mark.parametrize("distance_m", [0.8, 2.4])
def test_level_detection_is_where_an_upright_beacon_stands_on_the_slope(
    roll: float, pitch: float, azimuth: float, distance_m: float
) -> None:
    # From the middle between the wheels, in level axes: eye, robot's origin and foot of the beacon.
    height_m, origin_m, radius_m = 0.6, 0.15, 0.5 * BEACON.width_m
    eye, origin = (tilt((0.0, 0.0, -one), roll, pitch) for one in (height_m, origin_m))
    x, y = distance_m * math.cos(azimuth), distance_m * math.sin(azimuth)
    normal = tilt((0.0, 0.0, 1.0), roll, pitch)
    foot = np.array((x, y, -(normal[0] * x + normal[1] * y) / normal[2]))
    to_eye = (eye - foot)[:2] / math.hypot(*(eye - foot)[:2])
    front = foot + 0.25 * math.pi * radius_m * np.array((*to_eye, 0.0))
    axes = [tilt(axis, roll, pitch) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    # What `detect` measures: the slope of the lower band's middle, the azimuth of both bands'.
    low, middle = (front - (0.0, 0.0, h) - eye for h in (0.25, 0.3))
    ahead, right, down = (float(low @ axis) for axis in axes)
    measured_m = (height_m - 0.25) * math.hypot(ahead, right) / down + 0.25 * math.pi * radius_m
    bearing = math.atan2(float(middle @ axes[1]), float(middle @ axes[0]))
    covariance = np.array(((4e-4, 1e-5), (1e-5, 1e-4)))

    def level(range_m: float, bearing_rad: float) -> Detection:
        found = Detection("b", "beacon", range_m, bearing_rad, covariance, 9, True)
        return level_detection(found, BEACON, Viewpoint(height_m), roll_rad=roll, pitch_rad=pitch,
                               origin_height_m=origin_m)  # fmt: skip

    found = level(measured_m, bearing)
    true_m, true_rad = math.hypot(*(foot - origin)[:2]), math.atan2(*(foot - origin)[1::-1])
    # The middle of the bands is higher, hence nearer or farther: second order of the lean.
    assert found.range_m == pytest.approx(true_m, abs=1e-3)
    assert math.remainder(found.bearing_rad - true_rad, math.tau) == pytest.approx(0.0, abs=2e-3)
    columns = []
    for step in ((1e-6, 0.0), (0.0, 1e-6)):
        moved = level(measured_m + step[0], bearing + step[1])
        turn = math.remainder(moved.bearing_rad - found.bearing_rad, math.tau)
        columns.append(((moved.range_m - found.range_m) * 1e6, turn * 1e6))
    jacobian = np.array(columns).T
    # The front of the beacon turns with the ray, which its Jacobian leaves out.
    np.testing.assert_allclose(
        found.covariance, jacobian @ covariance @ jacobian.T, rtol=0.05, atol=1e-5
    )


def test_level_detection_without_a_range_turns_the_bearing_alone() -> None:
    variance = np.array(((0.0, 0.0), (0.0, 1e-4)))
    found = level_detection(
        Detection("b", "beacon", 0.0, 0.5, variance, 9, False), BEACON, Viewpoint(),
        roll_rad=0.3, pitch_rad=0.0,
    )  # fmt: skip
    # tan b' = cos(roll) tan b, and its derivative.
    expected = math.atan(math.cos(0.3) * math.tan(0.5))
    slope = math.cos(0.3) * (math.cos(expected) / math.cos(0.5)) ** 2
    assert (found.range_m, found.bearing_rad) == (0.0, pytest.approx(expected, abs=1e-12))
    np.testing.assert_allclose(found.covariance, variance * slope**2, rtol=1e-12)
