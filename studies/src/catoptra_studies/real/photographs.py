"""Photographs of a board: files, their coding, and the corners that a detector finds in them.

The one module of the study that opens files of pictures and finds boards. A file states its size in
its first bytes: a picture that is too large is rejected before a pixel is decoded. Twins are coded
as the photographs were, by the quality that their quantisation tables state, and their boards are
found by the same detector (cv2.findChessboardCornersSB, Duda & Frese, BMVC 2018).
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_studies.plot_style import Image

_SUFFIXES = (".jpg", ".jpeg", ".png")
# 8192 x 8192, the largest picture of a camera of the server.
_MAX_PIXELS = 2**26
# No histogram is normalized: behind a room of one colour that would merge the squares of a twin.
_FLAGS = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
# Of a corner off the middle of its neighbours, over their distance: 0.09 at most in photographs.
_MAX_UNEVENNESS = 0.15
# A half of them has to calibrate a camera, which the other half tests.
_MIN_BOARDS = 4
_QUALITIES = range(30, 101)


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard by its inner corners."""

    columns: int
    rows: int
    square_m: float

    @property
    def points_m(self) -> Floats:
        """(rows * columns, 3) corners in the board's frame, row by row."""
        return self.square_m * np.array(
            [(x, y, 0.0) for y in range(self.rows) for x in range(self.columns)]
        )


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """A picture with the corners of its board."""

    name: str
    rgb: Image
    corners_px: Floats | None
    """(rows * columns, 2), pixel centres at +0.5; None if no board was found."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotographSet:
    """Photographs of one size and one coding."""

    photographs: tuple[Photograph, ...]
    jpeg_quality: int | None
    """Quality of the standard tables nearest to the first file's; None if not JPEG."""

    @property
    def with_boards(self) -> tuple[Photograph, ...]:
        """Those in which a board was found."""
        return tuple(one for one in self.photographs if one.corners_px is not None)


def read_photographs(folder: Path, board: Board, size_px: tuple[int, int]) -> PhotographSet:
    """Read all photographs of a folder, by the numbers in their names, and find their boards.

    Args:
        folder: Folder of JPEG or PNG files.
        board: Board to look for.
        size_px: Width and height of the camera's pictures.

    Raises:
        CatoptraError: No picture, pictures of several sizes or of another camera's, one that is too
            large or cannot be decoded, or too few boards.
    """
    paths = [path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES] if (
        folder.is_dir()
    ) else []  # fmt: skip
    if not paths:
        raise CatoptraError(f"{folder}: no photographs: it has to be a folder of JPEG or PNG files")
    paths.sort(key=lambda path: (len(path.name), path.name))
    first_size, quality = _read_header(paths[0])
    for path in paths:
        size = _read_header(path)[0]
        if size != first_size:
            raise CatoptraError(
                f"{path}: {size[0]} x {size[1]} px, but {paths[0].name} has {first_size[0]} x "
                f"{first_size[1]}: a folder is of one camera and one size"
            )
    if first_size != size_px:
        raise CatoptraError(
            f"{paths[0]}: {first_size[0]} x {first_size[1]} px, but the camera file has "
            f"{size_px[0]} x {size_px[1]}: name the file of this camera by --camera-file"
        )
    photographs = tuple(_read_photograph(path, board) for path in paths)
    found = PhotographSet(photographs, quality)
    count = len(found.with_boards)
    if count < _MIN_BOARDS:
        raise CatoptraError(
            f"{folder}: a board of {board.columns} x {board.rows} inner corners is found in "
            f"{count} of {len(paths)} photographs, at least {_MIN_BOARDS} are needed: state its "
            "inner corners by --board"
        )
    return found


def find_corners(rgb: Image, board: Board) -> Floats | None:
    """(rows * columns, 2) inner corners in a picture, pixel centres at +0.5; None if not found.

    Where the detector misplaces a corner, as it does in one of 16 sharp twins, the picture is
    enlarged twofold and searched again.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    corners = _detect(grey, board)
    if corners is None or _is_even(corners, board):
        return corners
    enlarged = cv2.resize(grey, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC)
    again = _detect(enlarged, board)
    return corners if again is None else 0.5 * again


def _detect(grey: Any, board: Board) -> Floats | None:
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=_FLAGS)
    return corners.reshape(-1, 2).astype(np.float64) + 0.5 if found else None


def _is_even(corners_px: Floats, board: Board) -> bool:
    """Whether each corner lies near the middle of its neighbours, along rows and columns."""
    grid = corners_px.reshape(board.rows, board.columns, 2)
    for lines in (grid, grid.transpose(1, 0, 2)):
        span = np.linalg.norm(lines[:, 2:] - lines[:, :-2], axis=-1)
        off = np.linalg.norm(lines[:, 1:-1] - 0.5 * (lines[:, 2:] + lines[:, :-2]), axis=-1)
        if (off > _MAX_UNEVENNESS * span).any():
            return False
    return True


def code_picture(rgb: Image, jpeg_quality: int | None) -> Image:
    """A picture after coding and decoding as the photographs; None leaves it as it is."""
    if jpeg_quality is None:
        return rgb
    # OpenCV's chroma is sampled at half the pixels along both sides, as cameras do.
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    return np.asarray(cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB))


def refine_corners(channel: Any, corners_px: Floats) -> Floats:
    """Corners found again in one colour, (n, 2), by the gradients around known ones."""
    start = (corners_px - 0.5).astype(np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    refined = cv2.cornerSubPix(np.ascontiguousarray(channel), start, (3, 3), (-1, -1), stop)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2) + 0.5


def start_pose(board: Board, plane_points: Floats) -> Floats:
    """(6,) rotation vector and translation of a board by its corners in a plane at depth 1."""
    _, turn, shift = cv2.solvePnP(
        board.points_m, plane_points, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    return np.concatenate((turn.ravel(), shift.ravel()))


def matrix_from_vector(vector: Floats) -> Floats:
    """(3, 3) matrix of a rotation vector."""
    return np.asarray(cv2.Rodrigues(vector)[0])


def vector_from_matrix(matrix: Floats) -> Floats:
    """(3,) rotation vector of a matrix."""
    return np.asarray(cv2.Rodrigues(matrix)[0].ravel())


def write_jpeg(path: Path, rgb: Image, quality: int) -> None:
    """Write a picture as JPEG."""
    PIL.Image.fromarray(rgb).save(path, quality=quality)


def _read_header(path: Path) -> tuple[tuple[int, int], int | None]:
    """Size of a picture file and the quality of its coding, without decoding it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PIL.Image.DecompressionBombWarning)
            with PIL.Image.open(path) as image:
                size = (int(image.size[0]), int(image.size[1]))
                tables = getattr(image, "quantization", {})
    except PIL.Image.DecompressionBombError:
        size, tables = (_MAX_PIXELS, 2), {}
    except OSError as error:
        raise CatoptraError(f"{path}: no picture that can be read: {error}") from error
    if size[0] * size[1] > _MAX_PIXELS:
        raise CatoptraError(f"{path}: more than {_MAX_PIXELS} px, which is not decoded")
    return size, _nearest_quality(tuple(tables[0])) if tables else None


def _nearest_quality(table: Sequence[int]) -> int:
    """Quality of libjpeg whose luminance table is nearest to a file's."""
    given = np.array(table)
    return min(_QUALITIES, key=lambda quality: int(np.abs(_luminance_table(quality) - given).sum()))


@lru_cache(maxsize=128)
def _luminance_table(quality: int) -> Any:
    data = io.BytesIO()
    PIL.Image.new("L", (8, 8)).save(data, "JPEG", quality=quality)
    with PIL.Image.open(data) as image:
        return np.array(image.quantization[0])


def _read_photograph(path: Path, board: Board) -> Photograph:
    data = np.frombuffer(path.read_bytes(), np.uint8)
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if bgr is None:
        raise CatoptraError(f"{path}: the picture cannot be decoded")
    rgb = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
    return Photograph(path.stem, rgb, find_corners(rgb, board))
