"""OpenCV's own programs on rendered pictures: calibration by chessboards, poses of ArUco boards."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from catoptra_protocol.calibration.exports import ExportedFile, export_camera
from catoptra_protocol.calibration.formats import FORMATS
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.optics.lenses import UnifiedLens
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.render.renderer import Image
from helpers.rendered_boards import Cells, board_items, centre_board, place_board, render_boards
from outside.boards import BOARDS_PER_PICTURE, CAMERA, NUM_PICTURES, calibrate


@pytest.fixture
def exported(tmp_path: Path) -> cv2.FileStorage:
    """The exported file of the camera, as OpenCV reads it."""
    result = export_camera(CAMERA, FORMATS[0], name="cam", picture=Picture.FLIPPED)
    assert isinstance(result, ExportedFile)
    path = tmp_path / result.export.file_name
    path.write_text(result.text)
    return cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)


def test_opencv_calibrates_the_exported_camera_from_rendered_boards(
    exported: cv2.FileStorage,
) -> None:
    xi, matrix, rms_px, boards = calibrate()
    assert boards == NUM_PICTURES * BOARDS_PER_PICTURE
    assert rms_px < 0.15
    expected = exported.getNode("K").mat()
    assert xi == pytest.approx(exported.getNode("xi").real(), abs=1e-3)
    assert matrix[:2, 2] == pytest.approx(expected[:2, 2], abs=0.2)
    found = replace(
        CAMERA,
        projection=UnifiedLens(xi),
        centre_px=(matrix[0, 2] + 0.5, matrix[1, 2] + 0.5),
        scale_px=matrix[0, 0],
        rim_rad=CAMERA.rim_rad * 1.01,
    )
    assert compute_residual(CAMERA, found).max_px < 0.45


# ArUco.

# Axes right, down and forward of the flipped picture in the mirror frame: forward points up.
_MIRROR_FROM_PICTURE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

_DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
_MARKER_CELLS, _GAP_CELLS = 6, 2
_GRID = (3, 2)
_ARUCO_CELL_M = 0.012


def aruco_cells() -> tuple[Cells, dict[int, tuple[int, int]]]:
    """Cells of a board of 3 x 2 markers in a margin, and each marker's first row and column."""
    step = _MARKER_CELLS + _GAP_CELLS
    cells = np.zeros((_GRID[1] * step + _GAP_CELLS, _GRID[0] * step + _GAP_CELLS), dtype=np.bool_)
    places = {}
    for number in range(_GRID[0] * _GRID[1]):
        row, column = (_GAP_CELLS + step * index for index in divmod(number, _GRID[0]))
        marker = cv2.aruco.generateImageMarker(_DICTIONARY, number, _MARKER_CELLS)
        cells[row : row + _MARKER_CELLS, column : column + _MARKER_CELLS] = marker < 128
        places[number] = (row, column)
    return cells, places


def find_markers(image: Image) -> dict[int, Floats]:
    """(4, 2) corners of each marker found in a picture."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(_DICTIONARY, parameters)
    corners, numbers, _ = detector.detectMarkers(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    ids = [] if numbers is None else numbers.ravel().tolist()
    return {
        number: each.reshape(4, 2).astype(np.float64)
        for number, each in zip(ids, corners, strict=True)
    }


def test_aruco_board_is_found_in_the_flipped_picture_alone_with_its_pose(
    exported: cv2.FileStorage,
) -> None:
    cells, places = aruco_cells()
    pose = centre_board(
        place_board(82.0, 25.0, 0.35, tilt_rpy=(0.2, -0.3, 0.15)), cells, _ARUCO_CELL_M
    )
    image = render_boards(CAMERA, board_items("aruco", cells, _ARUCO_CELL_M, pose), samples=3)
    assert find_markers(np.ascontiguousarray(image[:, ::-1])) == {}
    markers = find_markers(image)
    assert set(markers) == set(places)
    side = np.array(((0, 0), (0, 1), (1, 1), (1, 0))) * _MARKER_CELLS  # row, column, clockwise
    points = np.concatenate([np.array(places[number]) + side for number in markers])
    board = np.pad(_ARUCO_CELL_M * points[:, ::-1].astype(np.float64), ((0, 0), (0, 1)))
    # Towards the board: a plane before the camera has no place for rays behind it.
    facing = place_board(82.0, 25.0, 1.0).rotation.T @ _MIRROR_FROM_PICTURE
    plane = cv2.omnidir.undistortPoints(
        np.concatenate(list(markers.values())).reshape(-1, 1, 2),
        exported.getNode("K").mat(),
        exported.getNode("D").mat(),
        np.array([exported.getNode("xi").real()]),
        facing,
    )
    _, turn, shift = cv2.solvePnP(board, plane, np.eye(3), None)
    rotation, _ = cv2.Rodrigues(turn)
    found_rotation = _MIRROR_FROM_PICTURE @ facing.T @ rotation
    found_m = _MIRROR_FROM_PICTURE @ facing.T @ shift.ravel()
    off_deg = math.degrees(
        math.acos(min(1.0, 0.5 * (np.trace(found_rotation.T @ pose.rotation) - 1.0)))
    )
    assert off_deg < 0.2
    assert np.linalg.norm(found_m - pose.translation) < 0.002
