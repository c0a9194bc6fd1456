"""The calibrated image plane and its grid of pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import (
    NO_CHANGE,
    ImagePlane,
    decentred_fold_rad,
    opencv_from_pixel,
    pixel_sample_positions,
    undo_distortion,
)
from catoptra_protocol.optics.lenses import EquidistantLens, UnifiedLens
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture

IMAGE = PerspectiveCamera(4, 3, 1.0)


def test_pixel_centres_when_one_sample_are_at_half_pixels() -> None:
    grid = pixel_sample_positions(IMAGE)
    assert grid.shape == (3, 4, 1, 2)
    assert grid[0, 0, 0].tolist() == [0.5, 0.5]
    assert grid[2, 3, 0].tolist() == [3.5, 2.5]


def test_pixel_centres_when_sampled_are_a_regular_grid_around_the_centre() -> None:
    grid = pixel_sample_positions(IMAGE, samples_per_side=2)
    assert grid.shape == (3, 4, 4, 2)
    assert sorted(map(tuple, grid[1, 2])) == [
        (2.25, 1.25),
        (2.25, 1.75),
        (2.75, 1.25),
        (2.75, 1.75),
    ]
    np.testing.assert_allclose(grid.mean(axis=2), pixel_sample_positions(IMAGE)[:, :, 0])


def test_opencv_pixel_of_the_first_pixel_s_centre_is_0() -> None:
    np.testing.assert_array_equal(opencv_from_pixel(np.array([0.5, 0.5])), (0.0, 0.0))


STRETCHED = ImagePlane((1.0, 0.002, 1e-4, 1.01))
DECENTRED = ImagePlane(p1=1e-3, p2=-5e-4)
POINTS = np.random.default_rng(5).uniform(-1.0, 1.0, size=(2, 200))


def test_plane_of_square_pixels_changes_nothing() -> None:
    assert NO_CHANGE.is_radial
    assert not NO_CHANGE.is_decentred
    assert NO_CHANGE.max_displacement_factor == 1.0
    assert not STRETCHED.is_radial
    assert not DECENTRED.is_radial


def test_stretch_is_a_matrix_and_is_undone() -> None:
    x, y = STRETCHED.apply_stretch(*POINTS)
    assert x == pytest.approx(POINTS[0] + 0.002 * POINTS[1])
    assert y == pytest.approx(1e-4 * POINTS[0] + 1.01 * POINTS[1])
    assert np.stack(STRETCHED.undo_stretch(x, y)) == pytest.approx(POINTS, abs=1e-15)
    low, high = STRETCHED.stretch_limits
    length = np.hypot(x, y) / np.hypot(*POINTS)
    assert low <= length.min() < length.max() <= high


def test_distortion_is_undone_up_to_the_fold() -> None:
    lens = UnifiedLens(1.19807, -0.25709, 0.01283)
    fold = float(lens.undistorted_ratio_from_t(np.array(lens.t_limit)))
    x, y = 0.99 * fold / math.sqrt(2.0) * POINTS
    gain, _ = lens.distortion_factor(x * x + y * y)
    dx, dy = DECENTRED.decentre(x, y)
    back_x, back_y, converged = undo_distortion(lens, DECENTRED, gain * x + dx, gain * y + dy)
    assert converged.all()
    assert back_x == pytest.approx(x, abs=1e-9)
    assert back_y == pytest.approx(y, abs=1e-9)


def test_point_beyond_the_fold_has_no_undistorted_one() -> None:
    lens = UnifiedLens(1.19807, -0.25709, 0.01283)
    beyond = 1.01 * float(lens.radius_ratio_from_t(np.array(lens.t_limit)))
    _, _, converged = undo_distortion(lens, DECENTRED, np.array([beyond]), np.array([0.0]))
    assert not converged.any()


@pytest.mark.parametrize("picture", list(Picture))
@pytest.mark.parametrize("up_rad", [0.0, 0.7])
def test_camera_with_a_stretched_plane_finds_its_directions_again(
    picture: Picture, up_rad: float
) -> None:
    lens = EquidistantLens()
    camera = OmniCamera(lens, 640, 480, (330.0, 230.0), 150.0, 1.9, up_rad, picture, STRETCHED)
    direction = np.random.default_rng(2).normal(size=(500, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    pixel, valid = camera.pixel_from_direction(direction)
    back, known = camera.direction_from_pixel(pixel[valid])
    assert known.all()
    assert back == pytest.approx(direction[valid], abs=1e-13)


@pytest.mark.parametrize("picture", list(Picture))
def test_flipped_camera_has_the_columns_reversed(picture: Picture) -> None:
    lens = EquidistantLens()
    camera = OmniCamera(lens, 640, 480, (330.0, 230.0), 150.0, 1.9, 0.3, picture, STRETCHED)
    other = next(each for each in Picture if each is not picture)
    direction = np.array([0.3, -0.2, 0.5])
    (u, v), (flipped_u, flipped_v) = (
        one.pixel_from_direction(direction)[0] for one in (camera, camera.with_picture(other))
    )
    assert (flipped_u, flipped_v) == pytest.approx((640.0 - u, v))
    assert camera.with_picture(other).with_picture(picture) == camera


@pytest.mark.parametrize(
    "stretch",
    [
        (1.0, 0.0, 0.0, -1.0),
        (1.0, 1.0, 1.0, 1.0),
        (math.nan,) * 4,
        (1.0, 10.0, -1e308, 1.0),
    ],
)
def test_plane_that_turns_round_or_collapses_is_rejected(
    stretch: tuple[float, float, float, float],
) -> None:
    with pytest.raises(DomainError, match="positive determinant"):
        ImagePlane(stretch)


THETA_BACK = UnifiedLens(1.19807, -0.25709, 0.01283)


def test_fold_of_a_decentred_lens_is_the_smallest_over_azimuths() -> None:
    plane = ImagePlane(p1=1e-3, p2=-5e-4)
    fold_rad = decentred_fold_rad(THETA_BACK, plane)
    assert math.degrees(fold_rad) == pytest.approx(117.88, abs=0.01)
    assert fold_rad < THETA_BACK.fold_rad
    # A rotation of the decentring turns the fold, and does not move it.
    turned = ImagePlane(p1=math.hypot(1e-3, 5e-4), p2=0.0)
    assert decentred_fold_rad(THETA_BACK, turned) == pytest.approx(fold_rad, abs=1e-6)
    assert math.isinf(decentred_fold_rad(UnifiedLens(2.0), plane))


def test_rim_beyond_the_fold_of_an_azimuth_is_rejected_with_both_angles() -> None:
    plane = ImagePlane(p1=1e-3, p2=-5e-4)
    size, centre = (960, 1080), (480.0, 540.0)
    message = r"turns back at 117\.88\d deg, although .* 118\.280 deg.* reaches 146\.6"
    with pytest.raises(DomainError, match=message):
        OmniCamera(THETA_BACK, *size, centre, 400.0, math.radians(118.2), plane=plane)
    camera = OmniCamera(THETA_BACK, *size, centre, 400.0, math.radians(117.8), plane=plane)
    # All directions up to there come back, where a solution beyond the fold was taken before.
    rng = np.random.default_rng(4)
    theta = np.radians(rng.uniform(116.8, 117.8, 20_000))
    azimuth = rng.uniform(-math.pi, math.pi, 20_000)
    sine = np.sin(theta)
    direction = np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)), axis=-1)
    pixel, valid = camera.pixel_from_direction(direction)
    back, known = camera.direction_from_pixel(pixel)
    assert valid.all()
    assert known.mean() > 0.999
    assert np.abs(back - direction)[known].max() < 1e-5


def test_published_lens_folds_at_angles_that_differ_by_azimuth() -> None:
    # BoofCV-Data's calibration of a Ricoh Theta, back lens; the formula written out.
    xi, k1, k2 = 1.19807286909, -0.257089970771, 0.0128307442205
    p1, p2 = -9.1179697419e-4, 3.91862130427e-4

    def image_of(theta: Floats, azimuth: Floats) -> Floats:
        m = np.sin(theta) / (xi + np.cos(theta))
        x, y, q = m * np.cos(azimuth), m * np.sin(azimuth), m * m
        gain = 1.0 + k1 * q + k2 * q * q
        dx = 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x)
        dy = p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y
        return np.stack((gain * x + dx, gain * y + dy))

    azimuth = np.linspace(-math.pi, math.pi, 181)[:, None]
    theta = np.radians(np.linspace(115.0, 121.0, 3001))
    step = 1e-5
    by_theta = image_of(theta + step, azimuth) - image_of(theta - step, azimuth)
    by_azimuth = image_of(theta, azimuth + step) - image_of(theta, azimuth - step)
    turns_back = by_theta[0] * by_azimuth[1] - by_theta[1] * by_azimuth[0] <= 0.0
    folds_deg = np.degrees(theta[turns_back.argmax(axis=1)])
    assert folds_deg.min() == pytest.approx(117.93, abs=0.01)
    assert folds_deg.max() == pytest.approx(118.64, abs=0.01)
    found = decentred_fold_rad(UnifiedLens(xi, k1, k2), ImagePlane(p1=p1, p2=p2))
    assert math.degrees(found) == pytest.approx(folds_deg.min(), abs=0.003)
