"""Photographs of boards: files, their coding, corners, and the camera that they calibrate.

The one module of the study that opens files of pictures and finds boards. A file states its size in
its first bytes: a picture that is too large is rejected before a pixel is decoded. Twins are coded
as the photographs were, by the quality that their quantisation tables state, and their boards are
found by the same detector (cv2.findChessboardCornersSB, Duda & Frese, BMVC 2018).

A camera is fitted to the boards, and judged by pictures that it was not fitted to. It is the
unified model (Mei & Rives, ICRA 2007) with two terms of radial and two of tangential distortion,
from the camera file's values on: Levenberg and Marquardt's method on all corners, six numbers a
board and nine of the camera. Corners are points, so poses do not depend on which way the board's
colours lie. Frame: the mirror frame, z along the optical axis. No outlier is left out: the
residuals are those of all corners.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image

from catoptra_protocol.calibration.model_fits import fit_mei
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import UnifiedLens
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
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


def _start_pose(board: Board, plane_points: Floats) -> Floats:
    """(6,) rotation vector and translation of a board by its corners in a plane at depth 1."""
    _, turn, shift = cv2.solvePnP(
        board.points_m, plane_points, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    return np.concatenate((turn.ravel(), shift.ravel()))


def _matrix_from_vector(vector: Floats) -> Floats:
    """(3, 3) matrix of a rotation vector."""
    return np.asarray(cv2.Rodrigues(vector)[0])


def _vector_from_matrix(matrix: Floats) -> Floats:
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


_MAX_STEPS = 40
# A fit ends where a step gains less than this part of the sum of squares.
_GAIN = 1e-9
_NUM_INTRINSICS = 9
# Steps of difference quotients: xi, k1, k2, p1, p2, log f, aspect, centre; rotation and metres.
_STEPS = np.array((1e-5, 1e-5, 1e-5, 1e-6, 1e-6, 1e-6, 1e-6, 1e-4, 1e-4))
_POSE_STEP = 1e-6
# What a camera may differ by from its file, a weak prior: few boards leave xi, k1, k2 and f free
# together. 4 000 corners of 0.5 px outweigh it a hundredfold.
_SIGMAS = np.array((0.3, 0.3, 0.3, 0.02, 0.02, 0.1, 0.05, 20.0, 20.0))
# Of the other hand's rms, below which the pictures are taken for turned round.
_MIRRORED_RATIO = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class BoardPose:
    """Pose of a board, and what is left of its corners."""

    vector: Floats
    """(6,) rotation vector and translation, mirror frame from board frame."""
    residual_px: Floats
    """(n, 2) projected corners less those found."""
    incidence_rad: Floats
    """(n,) angle from the axis."""

    @property
    def mirror_from_board(self) -> Pose:
        """The same as a transform."""
        return Pose(_matrix_from_vector(self.vector[:3]), self.vector[3:].copy())

    @property
    def mean_square_px(self) -> float:
        """Mean square distance of the corners."""
        return float(np.square(self.residual_px).sum(axis=1).mean())


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A camera with the poses of the boards that it was fitted to."""

    camera: OmniCamera
    poses: tuple[BoardPose, ...]


def rms(mean_squares: Sequence[float]) -> float:
    """Root of a mean of mean squares, which all count alike."""
    return math.sqrt(sum(mean_squares) / len(mean_squares))


def find_pose(camera: OmniCamera, corners_px: Floats, board: Board) -> BoardPose:
    """Pose of a board by its corners, with the camera as it is.

    Raises:
        CatoptraError: A corner lies outside the camera's picture.
    """
    directions, is_seen = camera.direction_from_pixel(corners_px)
    if not is_seen.all():
        raise CatoptraError(
            f"a board's corner lies beyond {math.degrees(camera.rim_rad):.0f} degrees, where the "
            "camera file ends: widen its field of view, or name the file of this camera"
        )
    middle = directions.mean(axis=0)
    middle /= np.linalg.norm(middle)
    right = np.cross((0.0, 0.0, 1.0) if abs(middle[2]) < 0.9 else (1.0, 0.0, 0.0), middle)
    right /= np.linalg.norm(right)
    view = np.stack((right, np.cross(middle, right), middle))
    rays = directions @ view.T
    start = _start_pose(board, rays[:, :2] / np.maximum(rays[:, 2:], 0.05))
    vector = np.concatenate(
        (_vector_from_matrix(view.T @ _matrix_from_vector(start[:3])), view.T @ start[3:])
    )
    vector, _ = _minimize(vector, lambda x: _pose_residuals(camera, x, corners_px, board))
    return _describe_pose(camera, vector, corners_px, board)


def calibrate(start: OmniCamera, corners_px: Sequence[Floats], board: Board) -> Calibration:
    """Fit a unified camera and the poses of boards to corners, from a camera on."""
    camera = start
    if not isinstance(start.projection, UnifiedLens):
        camera = fit_mei(start).with_picture(start.picture)
        camera = replace(camera, rim_rad=min(start.rim_rad, 0.999 * camera.fold_rad))
    numbers = _intrinsics(camera)
    poses = [find_pose(camera, corners, board).vector for corners in corners_px]
    first = np.concatenate((numbers, *poses))

    def residuals(x: Floats) -> Floats:
        model = _camera_of(camera, x[:_NUM_INTRINSICS])
        vectors = x[_NUM_INTRINSICS:].reshape(-1, 6)
        each = [
            _pose_residuals(model, vector, corners, board)
            for vector, corners in zip(vectors, corners_px, strict=True)
        ]
        return np.concatenate((*each, (x[:_NUM_INTRINSICS] - numbers) / _SIGMAS))

    def jacobian(x: Floats, value: Floats) -> Floats:
        found = np.zeros((len(value), len(x)))
        for column, step in enumerate(_STEPS):
            found[:, column] = (residuals(_step_along(x, column, step)) - value) / step
        model, row = _camera_of(camera, x[:_NUM_INTRINSICS]), 0
        for number, corners in enumerate(corners_px):
            rows = slice(row, row + 2 * len(corners))
            columns = slice(_NUM_INTRINSICS + 6 * number, _NUM_INTRINSICS + 6 * number + 6)
            of_pose = partial(_pose_residuals, model, corners_px=corners, board=board)
            found[rows, columns] = _differences(of_pose, x[columns], value[rows])
            row = rows.stop
        return found

    x, _ = _minimize(first, residuals, jacobian)
    fitted = _camera_of(camera, x[:_NUM_INTRINSICS])
    vectors = x[_NUM_INTRINSICS:].reshape(-1, 6)
    return Calibration(
        fitted,
        tuple(
            _describe_pose(fitted, vector, corners, board)
            for vector, corners in zip(vectors, corners_px, strict=True)
        ),
    )


def cross_validate(
    start: OmniCamera, corners_px: Sequence[Floats], board: Board
) -> tuple[BoardPose, ...]:
    """Poses of boards by cameras that were fitted to other pictures: the odd half, and the even.

    Neighbours in a series are alike, so the halves take turns.
    """
    halves = [calibrate(start, corners_px[half::2], board).camera for half in (0, 1)]
    return tuple(
        find_pose(halves[1 - number % 2], corners, board)
        for number, corners in enumerate(corners_px)
    )


def order_corners(corners_px: Floats, camera: OmniCamera, pose: Pose, board: Board) -> Floats:
    """Corners of a twin, counted from the corner that a pose begins with.

    Boards look the same after half a turn, and turned round; a detector may begin anywhere.
    """
    points = pose.transform_points(board.points_m)
    there = camera.pixel_from_direction(points)[0]
    grid = corners_px.reshape(board.rows, board.columns, 2)
    orders = (grid[::down, ::right].reshape(-1, 2) for down in (1, -1) for right in (1, -1))
    return min(orders, key=lambda corners: float(np.square(corners - there).sum()))


def measure_straightness_px(camera: OmniCamera, corners_px: Floats, board: Board) -> Floats:
    """(n,) distances of corners from the plane through the viewpoint that fits their row best.

    In pixels along the image radius: a straight row is a great circle of directions, whatever the
    pose.
    """
    directions, _ = camera.direction_from_pixel(corners_px)
    grid = directions.reshape(board.rows, board.columns, 3)
    off = np.stack([_off_plane(row) for row in grid])
    off_px = off.ravel() * camera.radius_slope_px(_half_tangent(directions))
    return np.abs(off_px)


def have_other_hand(camera: OmniCamera, corners_px: Sequence[Floats], board: Board) -> bool:
    """Whether pictures are turned round left to right, by the camera's own asymmetry.

    A camera whose axis is off the middle, or whose plane is decentred, fits pictures of its own
    hand better. Pictures of a symmetrical camera look the same either way: False.
    """
    turned = [np.stack((camera.width_px - c[:, 0], c[:, 1]), axis=-1) for c in corners_px]
    return _fixed_rms(camera, turned, board) < _MIRRORED_RATIO * _fixed_rms(
        camera, corners_px, board
    )


def _fixed_rms(camera: OmniCamera, corners_px: Sequence[Floats], board: Board) -> float:
    """Rms of boards with the camera as it is; inf where a corner is outside its picture."""
    try:
        return rms([find_pose(camera, corners, board).mean_square_px for corners in corners_px])
    except CatoptraError:
        return math.inf


def _off_plane(directions: Floats) -> Floats:
    normal = np.linalg.svd(directions)[2][2]
    return np.asarray(directions @ normal)


def _half_tangent(directions: Floats) -> Floats:
    rho = np.hypot(directions[..., 0], directions[..., 1])
    return np.asarray(np.tan(0.5 * np.arctan2(rho, directions[..., 2])))


def _intrinsics(camera: OmniCamera) -> Floats:
    lens, plane = camera.projection, camera.plane
    assert isinstance(lens, UnifiedLens), "made so by calibrate"
    aspect = plane.stretch[3]
    return np.array(
        (
            lens.xi,
            lens.k1,
            lens.k2,
            plane.p1,
            plane.p2,
            math.log(camera.scale_px),
            aspect,
            *camera.centre_px,
        )
    )


def _camera_of(camera: OmniCamera, numbers: Floats) -> OmniCamera:
    """The camera with other numbers. Raises DomainError for impossible ones."""
    xi, k1, k2, p1, p2, log_f, aspect, u, v = (float(value) for value in numbers)
    a, b, c, _ = camera.plane.stretch
    return replace(
        camera,
        projection=UnifiedLens(xi, k1, k2),
        plane=ImagePlane((a, b, c, aspect), p1, p2),
        scale_px=math.exp(log_f),
        centre_px=(u, v),
    )


def _pose_residuals(camera: OmniCamera, vector: Floats, corners_px: Floats, board: Board) -> Floats:
    points = board.points_m @ _matrix_from_vector(vector[:3]).T + vector[3:]
    return np.asarray((camera.pixel_from_direction(points)[0] - corners_px).ravel())


def _describe_pose(
    camera: OmniCamera, vector: Floats, corners_px: Floats, board: Board
) -> BoardPose:
    points = board.points_m @ _matrix_from_vector(vector[:3]).T + vector[3:]
    residual = _pose_residuals(camera, vector, corners_px, board).reshape(-1, 2)
    return BoardPose(vector, residual, 2.0 * np.arctan(_half_tangent(points)))


def _step_along(x: Floats, index: int, step: float) -> Floats:
    moved = x.copy()
    moved[index] += step
    return moved


def _differences(function: Callable[[Floats], Floats], x: Floats, value: Floats) -> Floats:
    columns = [
        (function(_step_along(x, i, _POSE_STEP)) - value) / _POSE_STEP for i in range(len(x))
    ]
    return np.stack(columns, axis=-1)


def _minimize(
    x: Floats,
    residuals: Callable[[Floats], Floats],
    jacobian: Callable[[Floats, Floats], Floats] | None = None,
) -> tuple[Floats, float]:
    """Least squares by Levenberg and Marquardt's method: the solution and its sum of squares."""
    value, damping = residuals(x), 1e-4
    total = float(value @ value)
    for _ in range(_MAX_STEPS):
        slope = jacobian(x, value) if jacobian else _differences(residuals, x, value)
        normal, gradient = slope.T @ slope, slope.T @ value
        before = total
        while damping < 1e8:
            damped = normal + damping * np.diag(np.diag(normal) + 1e-12)
            try:
                there = x - np.linalg.solve(damped, gradient)
                moved = residuals(there)
            except DomainError:
                moved = np.array((math.inf,))
            if float(moved @ moved) < total:
                x, value, total = there, moved, float(moved @ moved)
                damping = max(0.2 * damping, 1e-10)
                break
            damping *= 5.0
        if before - total <= _GAIN * before:
            break
    return x, total
