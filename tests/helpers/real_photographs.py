"""Photographs of a chessboard through a real mirror, which no repository holds: a folder of them.

`CATOPTRA_REAL_IMAGES` names a folder with `kaidan/`: the 17 photographs of tasptz/py-omnicalib
(`example/`, MIT licence), 640 x 480 px, of a board of 11 x 7 inner corners, 30 mm apart.
"""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from catoptra_client.frame import Pixels
from catoptra_protocol.optics.numerics import Floats

VARIABLE = "CATOPTRA_REAL_IMAGES"
BOARD = (11, 7)
_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY


def load_photographs() -> list[Pixels]:
    """RGB images, by the numbers in their names; the test is skipped without the folder."""
    folder = os.environ.get(VARIABLE, "")
    if not folder:
        pytest.skip(f"needs real photographs: {VARIABLE} names a folder with kaidan/*.jpg")
    paths = sorted(Path(folder, "kaidan").glob("*.jpg"), key=lambda path: (len(path.name), path))
    assert paths, f"{VARIABLE}={folder} has no kaidan/*.jpg"
    return [np.asarray(cv2.imread(str(path)))[..., ::-1].copy() for path in paths]


def find_board(image: Pixels) -> Floats | None:
    """(7, 11, 2) pixels of a board's inner corners, pixel centres at +0.5; None if not found."""
    found, corners = cv2.findChessboardCornersSB(
        cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), BOARD, flags=_FLAGS
    )
    return corners.reshape(BOARD[1], BOARD[0], 2).astype(np.float64) + 0.5 if found else None


def board_points() -> Floats:
    """(77, 3) corners in the board's frame, metres, row by row."""
    rows = np.stack(np.meshgrid(np.arange(BOARD[0]), np.arange(BOARD[1])), axis=-1).reshape(-1, 2)
    return 0.03 * np.pad(rows.astype(np.float64), ((0, 0), (0, 1)))
