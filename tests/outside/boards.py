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
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from helpers.rendered_boards import (
    board_items,
    centre_board,
    chessboard_cells,
    place_board,
    render_boards,
)
from outside.findings import Finding, version_of

# Corners have 0.1 px each, so 24 boards of 35 leave 1e-4 in xi and 0.1 % in gamma; three times.
BOUND_XI, BOUND_GAMMA, BOUND_CENTRE_PX, BOUND_RMS_PX = 0.002, 0.003, 0.3, 0.15
NUM_BOARDS = 24
_COLUMNS, _ROWS, _CELL_M = 7, 5, 0.028
_SIDE_PX = 1024


def paper_camera() -> OmniCamera:
    """The paper's mirror in an image of 1024 px, right-handed as OpenCV's."""
    return camera_with_inscribed_rim(
        PAPER_MIRROR, width_px=_SIDE_PX, height_px=_SIDE_PX, rim_rad=math.radians(120.0),
        picture=Picture.FLIPPED,
    )  # fmt: skip


def calibrate(camera: OmniCamera) -> tuple[float, float, tuple[float, float], float, int]:
    """xi, gamma, centre (pixel centres at +0.5), rms and number of boards, by OpenCV alone."""
    cells = chessboard_cells(_COLUMNS, _ROWS)
    rng = np.random.default_rng(3)
    corners = []
    for number in range(NUM_BOARDS):
        tilt = rng.uniform(-0.4, 0.4, 3)
        facing = place_board(rng.uniform(30.0, 95.0), 360.0 * number / NUM_BOARDS,
                             rng.uniform(0.28, 0.42), tilt_rpy=tilt.tolist())  # fmt: skip
        items = board_items("board", cells, _CELL_M, centre_board(facing, cells, _CELL_M))
        grey = cv2.cvtColor(render_boards(camera, items, samples=4), cv2.COLOR_RGB2GRAY)
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
        found, place = cv2.findChessboardCornersSB(grey, (_COLUMNS, _ROWS), flags=flags)
        if found:
            corners.append(place.reshape(-1, 1, 2).astype(np.float64))
    grid = np.zeros((_COLUMNS * _ROWS, 1, 3))
    grid[:, 0, :2] = _CELL_M * np.mgrid[:_COLUMNS, :_ROWS].T.reshape(-1, 2)
    flags = (cv2.omnidir.CALIB_FIX_SKEW + cv2.omnidir.CALIB_FIX_K1 + cv2.omnidir.CALIB_FIX_K2
             + cv2.omnidir.CALIB_FIX_P1 + cv2.omnidir.CALIB_FIX_P2)  # fmt: skip
    steps = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-9)
    rms, matrix, xi, *_ = cv2.omnidir.calibrate(
        [grid] * len(corners), corners, grey.shape[::-1], None, None, None, flags, steps
    )
    gamma = 0.5 * (matrix[0, 0] + matrix[1, 1])
    centre = (float(matrix[0, 2]) + 0.5, float(matrix[1, 2]) + 0.5)
    return float(np.ravel(xi)[0]), float(gamma), centre, float(rms), len(corners)


def compare_calibration() -> Iterator[Finding]:
    """Compare the calibration of pictures of the paper's camera with the paper's constants."""
    camera = paper_camera()
    k = PAPER_MIRROR.k
    s = math.sqrt(k * (k - 2.0))
    xi, gamma, centre, rms, boards = calibrate(camera)
    authority = version_of("opencv-contrib-python-headless") + ", cv2.omnidir.calibrate"
    note, error = f"{boards} of {NUM_BOARDS} boards found", f"rms {rms:.3f} px of the corners"
    row = Finding("", authority, 0.0, 0.0, 0.0, "", boards * _COLUMNS * _ROWS, error, note)
    focal = camera.scale_px * s / (k - 1.0)
    for subject, value, bound, unit in (
        (f"paper's xi {s / (k - 1.0):.5f}, found {xi:.5f}", abs(xi - s / (k - 1.0)), BOUND_XI, ""),
        (f"paper's gamma {focal:.2f} px, found {gamma:.2f}", abs(gamma / focal - 1.0), BOUND_GAMMA,
         "of gamma"),
        ("paper's centre", math.dist(centre, camera.centre_px), BOUND_CENTRE_PX, "px"),
        ("rms", rms, BOUND_RMS_PX, "px"),
    ):  # fmt: skip
        yield replace(row, subject=subject, largest=value, median=value, bound=bound, unit=unit)
