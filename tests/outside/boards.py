"""The paper's geometry by `cv2.omnidir.calibrate`, from chessboards that the server draws.

OpenCV finds the corners itself. A hyperbolic mirror is the unified model of xi = s / (k - 1) and
gamma = f / (k - 1), with s = sqrt(k (k - 2)); the paper's Eq. 2 is that of xi = 1, outside
the bound. Skew and distortion are fixed at 0: a mirror has none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import Image
from helpers.rendered_boards import (
    board_items,
    centre_board,
    chessboard_cells,
    place_board,
    render_boards,
)
from outside.findings import Finding, version_of

# Corners have 0.1 px each, so 20 boards of 54 leave 1e-4 in xi and 0.1 % in gamma; three times.
BOUND_XI, BOUND_GAMMA, BOUND_CENTRE_PX, BOUND_RMS_PX = 0.002, 0.003, 0.3, 0.15
NUM_PICTURES, BOARDS_PER_PICTURE = 4, 5
CAMERA = camera_with_inscribed_rim(
    PAPER_MIRROR, width_px=1024, height_px=1024, rim_rad=math.radians(120.0),
    picture=Picture.FLIPPED,
)  # fmt: skip
_BOARD, _CELL_M = (9, 6), 0.03
_CHESS = chessboard_cells(*_BOARD)
# (54, 3) inner corners from the outer corner, metres: two cells in, the margin and a first square.
_CORNERS = np.zeros((_BOARD[0] * _BOARD[1], 3))
_CORNERS[:, :2] = _CELL_M * (np.mgrid[: _BOARD[0], : _BOARD[1]].T.reshape(-1, 2) + 2)
_FIND = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
_REFINE = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-5)
_FIXED = sum(getattr(cv2.omnidir, f"CALIB_FIX_{n}") for n in ("SKEW", "K1", "K2", "P1", "P2"))


def calibrate() -> tuple[float, Floats, float, int]:
    """xi, (3, 3) matrix (pixel centres at integers), rms and number of boards, by OpenCV alone."""
    rng = np.random.default_rng(5)
    corners = [each for _ in range(NUM_PICTURES) for each in _photograph_boards(rng)]
    rms, matrix, xi, distortion, _, _, used = cv2.omnidir.calibrate(
        [_CORNERS[:, None]] * len(corners), corners, (CAMERA.width_px, CAMERA.height_px),
        np.eye(3), np.zeros(1), np.zeros((1, 4)), _FIXED, (3, 500, 1e-12),
    )  # fmt: skip
    assert not distortion.any()
    return float(xi[0]), matrix, float(rms), int(used.size)


def _photograph_boards(rng: np.random.Generator) -> list[Floats]:
    """(54, 1, 2) corners of each board around the mirror in one picture."""
    poses = []
    for index in range(BOARDS_PER_PICTURE):
        facing = place_board(
            rng.uniform(55.0, 100.0),
            360.0 / BOARDS_PER_PICTURE * index + rng.uniform(-8.0, 8.0),
            rng.uniform(0.28, 0.42),
            tilt_rpy=rng.uniform((-0.5, -0.5, -0.6), (0.5, 0.5, 0.6)),
        )
        poses.append(centre_board(facing, _CHESS, _CELL_M))
    items = [item for pose in poses for item in board_items("board", _CHESS, _CELL_M, pose)]
    image = render_boards(CAMERA, items, samples=4)
    return [_find_corners(image, pose) for pose in poses]


def _find_corners(image: Image, pose: Pose) -> Floats:
    """Corners that OpenCV finds in the part of a picture around a board."""
    expected, _ = CAMERA.pixel_from_direction(pose.transform_points(_CORNERS))
    low = np.maximum(expected.min(axis=0) - 40.0, 0.0).astype(int)
    high = (expected.max(axis=0) + 40.0).astype(int)
    part = cv2.cvtColor(image[low[1] : high[1], low[0] : high[0]], cv2.COLOR_RGB2GRAY)
    found, corners = cv2.findChessboardCornersSB(part, _BOARD, flags=_FIND)
    assert found
    cv2.cornerSubPix(part, corners, (5, 5), (-1, -1), _REFINE)
    pixels = corners.reshape(-1, 1, 2).astype(np.float64) + low
    # A board of 9 x 6 is found from either end.
    ends = np.linalg.norm(pixels[[0, -1], 0] - expected[0], axis=-1)
    return pixels if ends[0] < ends[1] else pixels[::-1]


def compare_calibration() -> Iterator[Finding]:
    """Compare the calibration of pictures of the paper's camera with the paper's constants."""
    k = PAPER_MIRROR.k
    xi = math.sqrt(k * (k - 2.0)) / (k - 1.0)
    gamma = CAMERA.scale_px * xi
    found_xi, matrix, rms, boards = calibrate()
    found_gamma = 0.5 * (matrix[0, 0] + matrix[1, 1])
    off_px = math.dist(matrix[:2, 2] + 0.5, CAMERA.centre_px)
    authority = version_of("opencv-contrib-python-headless") + ", cv2.omnidir.calibrate"
    note, error = f"{boards} boards", f"rms {rms:.3f} px of the corners"
    row = Finding("", authority, 0.0, 0.0, 0.0, "", boards * len(_CORNERS), error, note)
    for subject, value, bound, unit in (
        (f"paper's xi {xi:.5f}, found {found_xi:.5f}", abs(found_xi - xi), BOUND_XI, ""),
        (f"paper's gamma {gamma:.2f} px, found {found_gamma:.2f}", abs(found_gamma / gamma - 1.0),
         BOUND_GAMMA, "of gamma"),
        ("paper's centre", off_px, BOUND_CENTRE_PX, "px"),
        ("rms", rms, BOUND_RMS_PX, "px"),
    ):  # fmt: skip
        yield replace(row, subject=subject, largest=value, median=value, bound=bound, unit=unit)
