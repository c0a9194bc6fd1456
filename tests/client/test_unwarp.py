"""Unwarping: geometry of both images, and their content against the camera model."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_client.unwarp import (
    CylinderGeometry,
    PerspectiveGeometry,
    make_unwarp_map,
    unwarp,
    unwarp_channels,
    unwarp_labels,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import (
    camera_with_inscribed_rim,
    direction_from_pixel,
    pixel_from_direction,
)
from helpers.labelled_rooms import CAMERAS

CAMERA = camera_with_inscribed_rim(
    PAPER_MIRROR, width_px=360, height_px=360, rim_rad=math.radians(120)
)
CYLINDER = CylinderGeometry(columns=720, rows=170, top_slope=-0.15, bottom_slope=1.5)
FORWARD = PerspectiveGeometry(width_px=161, height_px=121, horizontal_fov_rad=math.radians(60))


def make_frame(value_from_direction) -> np.ndarray:
    """(360, 360, 3) frame whose grey value is a function of the direction."""
    direction, seen = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA)[:, :, 0])
    value = np.where(seen, value_from_direction(direction), 0.0)
    return np.repeat(np.round(value).astype(np.uint8)[..., None], 3, axis=-1)


def make_gaussian_spot(azimuth_rad: float, slope: float):
    """Bright Gaussian spot of 1.5 degrees at an azimuth and a slope."""
    centre = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), slope])
    centre /= np.linalg.norm(centre)

    def evaluate(direction):
        squared = np.square(direction - centre).sum(axis=-1)
        return 250.0 * np.exp(-0.5 * squared / math.radians(1.5) ** 2)

    return evaluate


def centroid(picture: np.ndarray) -> tuple[float, float]:
    """Column and row of an image's brightness centroid, centres at +0.5."""
    weight = picture[..., 0].astype(float)
    rows, columns = np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5
    return (weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()


@pytest.mark.parametrize("azimuth_deg", [-179.0, -90.0, -0.01, 0.0, 45.0, 90.0, 135.0, 178.0])
def test_column_and_azimuth_are_inverse(azimuth_deg: float) -> None:
    azimuth = math.radians(azimuth_deg)
    column = CYLINDER.column_from_azimuth(np.array(azimuth))
    assert CYLINDER.azimuth_from_column(column) == pytest.approx(azimuth, abs=1e-12)


@pytest.mark.parametrize("azimuth", [-math.pi, math.pi, 3 * math.pi, -math.pi - 1e-17])
def test_seam_belongs_to_the_first_column(azimuth: float) -> None:
    assert CYLINDER.column_from_azimuth(np.array(azimuth)) == pytest.approx(0.0, abs=1e-12)


def test_column_of_the_smallest_step_before_the_seam_stays_inside() -> None:
    geometry = CylinderGeometry(10, 10, 0.0, 1.0, seam_azimuth_rad=0.0)
    assert 0.0 <= geometry.column_from_azimuth(np.array(-1e-18)) < 10.0


def test_row_and_slope_are_inverse_and_heights_are_linear() -> None:
    heights = np.array([0.2, 0.3, 0.4])
    rows = CYLINDER.row_from_slope((0.6 - heights) / 1.3)
    assert np.diff(rows)[0] == pytest.approx(np.diff(rows)[1], rel=1e-12)
    np.testing.assert_allclose(CYLINDER.slope_from_row(rows), (0.6 - heights) / 1.3)


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, -60.0, 150.0])
@pytest.mark.parametrize("slope", [0.02, 0.2, 0.6])
def test_spot_appears_in_the_cylinder_at_its_azimuth_and_slope(azimuth_deg, slope) -> None:
    azimuth = math.radians(azimuth_deg)
    cylinder = unwarp(
        make_frame(make_gaussian_spot(azimuth, slope)), make_unwarp_map(CAMERA, CYLINDER)
    )
    column, row = centroid(cylinder)
    # 0.2 of a column is 0.1 degrees: a fifth of a source pixel, and rows stretch the spot a little.
    assert column == pytest.approx(CYLINDER.column_from_azimuth(np.array(azimuth)), abs=0.2)
    assert row == pytest.approx(CYLINDER.row_from_slope(np.array(slope)), abs=0.35)


def test_cylinder_is_not_mirrored_a_landmark_on_the_right_is_right() -> None:
    cylinder = unwarp(
        make_frame(make_gaussian_spot(math.pi / 2, 0.2)), make_unwarp_map(CAMERA, CYLINDER)
    )
    assert centroid(cylinder)[0] == pytest.approx(540.0, abs=0.2)


@pytest.mark.parametrize(("right_deg", "down_deg"), [(0, 0), (20, 0), (-20, 10), (0, 15)])
def test_spot_appears_in_the_perspective_where_a_pinhole_sees_it(right_deg, down_deg) -> None:
    right, down = math.tan(math.radians(right_deg)), math.tan(math.radians(down_deg))
    azimuth, slope = math.atan(right), down / math.hypot(1.0, right)
    picture = unwarp(
        make_frame(make_gaussian_spot(azimuth, slope)), make_unwarp_map(CAMERA, FORWARD)
    )
    expected = (80.5 + FORWARD.focal_length_px * right, 60.5 + FORWARD.focal_length_px * down)
    assert centroid(picture) == pytest.approx(expected, abs=0.25)


def test_perspective_turned_and_pitched_looks_along_its_axis() -> None:
    yaw, pitch = math.radians(70.0), math.radians(-25.0)
    geometry = PerspectiveGeometry(161, 121, math.radians(50), yaw_rad=yaw, pitch_rad=pitch)
    picture = unwarp(
        make_frame(make_gaussian_spot(yaw, math.tan(-pitch))), make_unwarp_map(CAMERA, geometry)
    )
    assert centroid(picture) == pytest.approx((80.5, 60.5), abs=0.25)


def test_pixel_outside_the_mirror_is_invalid_and_black() -> None:
    above = CylinderGeometry(columns=90, rows=40, top_slope=-1.0, bottom_slope=1.0)
    mapping = make_unwarp_map(CAMERA, above)
    rim_row = above.row_from_slope(np.array(-math.tan(math.radians(30))))
    assert not mapping.valid[: int(rim_row)].any()
    assert mapping.valid[int(rim_row) + 1 :].all()
    picture = unwarp(np.full((360, 360, 3), 200, np.uint8), mapping)
    assert not picture[~mapping.valid].any()


def test_half_a_disc_is_valid_on_the_side_that_the_frame_shows() -> None:
    half = dataclasses.replace(CAMERA, width_px=180, centre_px=(0.0, 180.0))
    valid = make_unwarp_map(half, CYLINDER).valid
    # The image is mirrored: right of the image centre is to the robot's left.
    assert valid[:, 5:355].all()
    assert not valid[:, 365:715].any()


def test_frame_of_another_size_is_rejected() -> None:
    with pytest.raises(DomainError, match="360 x 360"):
        unwarp(np.zeros((360, 361, 3), np.uint8), make_unwarp_map(CAMERA, CYLINDER))


@pytest.mark.parametrize(
    "make",
    [
        lambda: CylinderGeometry(0, 10, 0.0, 1.0),
        lambda: CylinderGeometry(10, 40000, 0.0, 1.0),
        lambda: CylinderGeometry(10, 10, 1.0, 1.0),
        lambda: CylinderGeometry(10, 10, 0.0, math.inf),
        lambda: PerspectiveGeometry(10, 10, math.pi),
        lambda: PerspectiveGeometry(10, 10, 1.0, yaw_rad=math.nan),
    ],
)
def test_geometry_without_a_image_is_rejected(make) -> None:
    with pytest.raises(DomainError):
        make()


@pytest.mark.parametrize("azimuth", [math.nan, math.inf])
def test_azimuth_that_is_not_finite_has_no_column_and_says_which(azimuth: float) -> None:
    with pytest.raises(DomainError, match="azimuth") as refused:
        CylinderGeometry(8, 4, 0.0, 1.0).column_from_azimuth(np.array([0.0, azimuth]))
    assert refused.value.valid_mask.tolist() == [True, False]


@pytest.mark.parametrize("slopes", [(-1.7e308, 1.7e308), (0.0, 5e-324)])
def test_rows_that_float64_cannot_hold_are_rejected(slopes) -> None:
    with pytest.raises(DomainError, match="float64"):
        CylinderGeometry(8, 4, *slopes)


def test_view_too_narrow_for_a_focal_length_is_rejected() -> None:
    with pytest.raises(DomainError, match="focal length"):
        PerspectiveGeometry(8, 4, 5e-324)


def test_channels_are_unwarped_from_the_nearest_pixel_without_mixing() -> None:
    camera = CAMERAS["paper"]
    geometry = CylinderGeometry(90, 20, -0.1, 0.8)
    unwarp_map = make_unwarp_map(camera, geometry)
    rows, columns = np.mgrid[: camera.height_px, : camera.width_px]
    ids = (1 + rows * camera.width_px + columns).astype(np.uint16)
    ranges = np.full(ids.shape, np.inf, dtype=np.float32)
    found = unwarp_channels({"ids": ids, "range": ranges}, unwarp_map)
    pixel, _ = pixel_from_direction(camera, geometry.directions())
    valid = unwarp_map.valid
    assert valid.mean() > 0.8
    number = found["ids"][valid].astype(int) - 1
    centre = np.column_stack((number % camera.width_px, number // camera.width_px)) + 0.5
    # Of the pixel whose square holds the point, to the 1/32 px of the map.
    assert np.abs(centre - pixel[valid]).max() < 0.5 + 1.0 / 16.0
    assert (found["ids"][~valid] == 0).all()
    assert found["range"].dtype == np.float32


def test_labels_are_unwarped_as_channels_are_and_are_zero_where_nothing_is_seen() -> None:
    camera = CAMERAS["paper"]
    unwarp_map = make_unwarp_map(camera, CylinderGeometry(90, 20, -0.8, 0.8))
    shape = (camera.height_px, camera.width_px)
    labels = np.random.default_rng(0).integers(1, 256, shape, dtype=np.uint8)
    found = unwarp_labels(labels, unwarp_map)
    expected = unwarp_channels({"ids": labels.astype(np.uint16)}, unwarp_map)["ids"]
    assert 0.1 < unwarp_map.valid.mean() < 0.9
    np.testing.assert_array_equal(found, expected)


def test_channels_and_labels_of_another_size_are_rejected() -> None:
    unwarp_map = make_unwarp_map(CAMERAS["paper"], CylinderGeometry(90, 20, -0.1, 0.8))
    with pytest.raises(DomainError, match="labels of"):
        unwarp_labels(np.zeros((3, 4), dtype=np.uint8), unwarp_map)
    with pytest.raises(DomainError, match="not ids"):
        unwarp_channels({"ids": np.zeros((3, 4), dtype=np.uint16)}, unwarp_map)
