"""Pictures of our own with known effects in place of photographs: the measures find them again."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel_grid
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.kernels.lens_blur import Aperture, circle_of_confusion
from catoptra_studies.plot_style import Image
from catoptra_studies.real.photographs import (
    Board,
    Calibration,
    calibrate,
    find_corners,
    order_corners,
)
from catoptra_studies.real.picture_measures import (
    PictureMeasures,
    encoded_level,
    linear_light,
    measure_picture,
    shading_loss,
)
from catoptra_studies.real.twin import TwinCamera, write_mirror_camera
from helpers.board_pictures import (
    BLACK,
    BOARD,
    WHITE,
    KnownPictures,
    known_poses,
    write_lens,
    write_pictures,
)

FOCAL_PX, FOCUS_M, PITCH_M = 400.0, 0.097, 7.4e-6
KAIDAN_BOARD = Board(11, 7, 0.03)
FULL_WELL_E, READ_NOISE_E = 2000.0, 10.0


def read(known: KnownPictures) -> list[Image]:
    paths = sorted(known.folder.glob("*.png"))
    return [np.asarray(PillowImage.open(path)) for path in paths]


def measure(known: KnownPictures) -> list[PictureMeasures]:
    return [
        measure_picture(rgb, known.camera, pose, BOARD)
        for rgb, pose in zip(read(known), known.poses, strict=True)
    ]


@pytest.fixture(scope="module")
def mirror_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mirror")
    lens = TwinCamera(write_lens(folder / "lens.ini", 640), folder, "tripod").camera
    path = folder / "mirror.ini"
    write_mirror_camera(path, lens, focal_px=FOCAL_PX, vertex_m=0.1)
    return path


@pytest.fixture(scope="module")
def lens_pictures(tmp_path_factory: pytest.TempPathFactory) -> KnownPictures:
    folder = tmp_path_factory.mktemp("lens")
    camera = write_lens(folder / "lens.ini", 640)
    return write_pictures(folder, camera, known_poses(8, KAIDAN_BOARD, 0.24), board=KAIDAN_BOARD)


@pytest.fixture(scope="module")
def calibration(lens_pictures: KnownPictures) -> Calibration:
    """Calibration by the pictures alone, from a camera that is wrong by some per cent."""
    truth = lens_pictures.camera
    start = dataclasses.replace(
        truth, scale_px=1.02 * truth.scale_px, centre_px=(truth.centre_px[0] + 3.0, 245.0)
    )
    corners = [
        order_corners(found, truth, pose, KAIDAN_BOARD)
        for rgb, pose in zip(read(lens_pictures), lens_pictures.poses, strict=True)
        if (found := find_corners(rgb, KAIDAN_BOARD)) is not None
    ]
    assert len(corners) == 8
    return calibrate(start, corners, KAIDAN_BOARD)


def test_poses_are_found_within_a_millimetre_and_a_tenth_of_a_degree(
    lens_pictures: KnownPictures, calibration: Calibration
) -> None:
    for found, pose in zip(calibration.poses, lens_pictures.poses, strict=True):
        off = found.mirror_from_board.inverse() @ pose
        middle = pose.transform_points(KAIDAN_BOARD.points_m.mean(axis=0))
        there = found.mirror_from_board.transform_points(KAIDAN_BOARD.points_m.mean(axis=0))
        assert np.linalg.norm(there - middle) <= 1e-3
        assert math.degrees(2.0 * math.acos(min(1.0, abs(off.quaternion[3])))) <= 0.1


def test_radial_function_is_found_within_0_3_px(
    lens_pictures: KnownPictures, calibration: Calibration
) -> None:
    t = np.tan(0.5 * np.radians(np.linspace(54.0, 120.0, 34)))
    off_px = calibration.camera.radius_px_from_t(t) - lens_pictures.camera.radius_px_from_t(t)
    assert np.abs(off_px).max() <= 0.3


def disc_width_px(diameter_px: float) -> float:
    """10 to 90 % of an edge behind a disc and a pixel, in encoded levels, by numbers alone."""
    x = np.arange(-8.0, 8.0, 0.01)
    chord = np.sqrt(np.maximum(0.25 * diameter_px**2 - np.square(x), 0.0)) + 1e-12
    step = np.cumsum(np.convolve(chord, np.abs(x) <= 0.5, mode="same"))
    low, high = (float(linear_light(np.array(level))) for level in (BLACK, WHITE))
    levels = encoded_level(low + (high - low) * step / step[-1])
    share = (levels - BLACK) / (WHITE - BLACK)
    return float(np.interp(0.9, share, x) - np.interp(0.1, share, x))


def paint_board(camera: OmniCamera, pose: Pose, disc_px: float) -> Image:
    """A board behind discs of one size, by sums over parts of pixels: no renderer has a hand in it.

    Each pixel is the mean of 7 x 7 parts, so that its box and the disc are those of `disc_width_px`
    at any angle of an edge; server frames sum 3 x 3 parts and weigh whole pixels.
    """
    parts = 7
    points = pose.transform_points(BOARD.points_m)
    corners = camera.pixel_from_direction(points)[0]
    low, high = np.floor(corners.min(axis=0)) - 30.0, np.ceil(corners.max(axis=0)) + 30.0
    u, v = (np.arange(a, b, 1.0 / parts) + 0.5 / parts for a, b in zip(low, high, strict=True))
    directions, _ = direction_from_pixel_grid(camera, u, v)
    normal = pose.rotation[:, 2]
    there = directions * ((pose.translation @ normal) / (directions @ normal))[..., None]
    x, y = np.moveaxis((there - pose.translation) @ pose.rotation[:, :2] / BOARD.square_m, -1, 0)
    is_on = (x > -1) & (x < BOARD.columns) & (y > -1) & (y < BOARD.rows)
    is_black = is_on & ((np.floor(x) + np.floor(y)) % 2 == 0)
    light = linear_light(np.where(is_black, BLACK, WHITE))
    radius = math.ceil(0.5 * disc_px * parts)
    i, j = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    disc = (np.hypot(i, j) <= 0.5 * disc_px * parts).astype(np.float64)
    blurred = cv2.filter2D(light, -1, disc / disc.sum())
    rows, columns = (side // parts for side in blurred.shape)
    mean = blurred.reshape(rows, parts, columns, parts).mean(axis=(1, 3))
    picture = np.full((camera.height_px, camera.width_px, 3), WHITE, np.uint8)
    left, top = low.astype(int)
    levels = np.rint(encoded_level(mean)).astype(np.uint8)
    picture[top : top + rows, left : left + columns] = levels[..., None]
    return picture


@pytest.mark.parametrize("width_px", [1.2, 1.6, 2.2, 3.0])
def test_width_of_painted_edges_is_found_within_10_per_cent(
    mirror_file: Path, tmp_path: Path, width_px: float
) -> None:
    camera = TwinCamera(mirror_file, tmp_path).camera
    disc_px = float(np.interp(width_px, disc_widths_px(), DISCS_PX))
    straight, level, _ = known_poses(3)
    # Turned about its diagonal, a board's sides are no right angle in the picture.
    middle = 0.5 * (BOARD.points_m[0] + BOARD.points_m[-1])
    turn, _ = cv2.Rodrigues(np.array((0.6, 0.6, 0.0)))
    oblique = straight @ Pose(turn, middle - turn @ middle)
    for pose in (straight, level, oblique):
        found = measure_picture(paint_board(camera, pose, disc_px), camera, pose, BOARD)
        assert len(found.edge_widths_px) >= 40
        assert found.edge_width_px == pytest.approx(width_px, rel=0.1)


DISCS_PX = np.arange(0.5, 5.0, 0.1)


@lru_cache(maxsize=1)
def disc_widths_px() -> tuple[float, ...]:
    """Widths of edges behind DISCS_PX."""
    return tuple(disc_width_px(float(diameter)) for diameter in DISCS_PX)


def expected_width_px(
    camera: OmniCamera, incidence_rad: Floats, range_m: float, f_number: float
) -> float:
    radius = camera.radius_px_from_t(np.tan(0.5 * incidence_rad))
    circle = circle_of_confusion(Aperture(f_number, PITCH_M, FOCUS_M), camera, radius)
    # Of all edges: some would be those of a few columns, at other incidences.
    width_px = np.interp(circle.diameter_px(np.array(range_m)), DISCS_PX, disc_widths_px())
    return float(np.median(width_px))


@pytest.mark.parametrize(("f_number", "least_px"), [(1.5, 1.9), (3.0, 1.15)])
def test_edge_width_of_known_defocus_is_found_within_10_per_cent(
    mirror_file: Path, tmp_path: Path, f_number: float, least_px: float
) -> None:
    # Drawn edges are up to 7 % narrower than a disc's at F/3: 3 x 3 rays make a smaller box than
    # the pixel, and a disc is weights of whole pixels, of its variance. Painted ones are not.
    lens = (f"FNumber={f_number}", f"PixelPitch={PITCH_M}", f"FocusDistance={FOCUS_M}")
    known = write_pictures(
        tmp_path, mirror_file, known_poses(2),
        effects=("Defocus=always", "DefocusByDepth=always", *lens),
    )  # fmt: skip
    found = measure(known)
    for one in found:
        expected = expected_width_px(known.camera, one.edge_incidence_rad, 0.3, f_number)
        assert expected > least_px
        assert one.edge_width_px == pytest.approx(expected, rel=0.1)


def test_noise_of_known_sensor_is_found_within_10_per_cent(
    mirror_file: Path, tmp_path: Path
) -> None:
    effects = ("ShotNoise=always", "ReadNoise=always", f"FullWell={FULL_WELL_E}",
               f"ReadNoiseElectrons={READ_NOISE_E}")  # fmt: skip
    known = write_pictures(tmp_path, mirror_file, known_poses(3), effects=effects)
    found = measure(known)
    for is_white, level in ((True, WHITE), (False, BLACK)):
        light = float(linear_light(np.array(level)))
        deviation = math.sqrt(light / FULL_WELL_E + (READ_NOISE_E / FULL_WELL_E) ** 2)
        slope = float(encoded_level(np.array(light + 1e-5)) - level) / 1e-5
        # Grey is a mean of three colours with noise of their own, each rounded.
        expected = math.hypot(0.299, 0.587, 0.114) * math.hypot(
            slope * deviation, math.sqrt(1 / 12)
        )
        measured = np.median([one.noise(is_white) for one in found])
        assert measured == pytest.approx(expected, rel=0.1)


def test_vignetting_of_known_lens_is_found_within_10_per_cent(
    mirror_file: Path, tmp_path: Path
) -> None:
    known = write_pictures(tmp_path, mirror_file, known_poses(6), effects=("Vignetting=always",))
    rim = np.array(known.camera.rim_radius_px)
    expected = 1.0 - float(known.camera.relative_illumination(rim))
    assert expected > 0.2
    loss = shading_loss(np.sum([one.shading_sums for one in measure(known)], axis=0))
    assert float(loss) == pytest.approx(expected, rel=0.1)


def test_clean_pictures_have_corners_within_0_2_px_of_their_projections(
    lens_pictures: KnownPictures,
) -> None:
    squares = []
    for rgb, pose in zip(read(lens_pictures), lens_pictures.poses, strict=True):
        found = find_corners(rgb, KAIDAN_BOARD)
        assert found is not None
        squares.append(np.square(_off_px(lens_pictures.camera, found, pose)).mean())
    assert math.sqrt(np.mean(squares)) <= 0.2


def _off_px(camera: OmniCamera, corners_px: Floats, pose: Pose) -> Floats:
    ordered = order_corners(corners_px, camera, pose, KAIDAN_BOARD)
    there = camera.pixel_from_direction(pose.transform_points(KAIDAN_BOARD.points_m))[0]
    return np.asarray(np.linalg.norm(ordered - there, axis=1))
