"""The shipped camera of a real mirror against photographs through it: re-projection, unwarping."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from catoptra_client.frame import Pixels
from catoptra_client.unwarp import PerspectiveGeometry, make_unwarp_map, unwarp
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.camera_file import carry_camera, read_camera_files
from helpers.real_photographs import board_points, find_board, load_photographs

VIEW_PX = 400
"""Side of an unwrapped view."""
FOCAL_PX = 97.0
"""Focal length of a view: the photographs have 17 px per 10 degrees where the boards are."""


@pytest.fixture(scope="module")
def photographs() -> list[Pixels]:
    return load_photographs()


@pytest.fixture
def camera(tmp_path: Path) -> OmniCamera:
    return carry_camera(read_camera_files(["kaidan_360"])[0], tmp_path / "robot.ini").camera


def facing_view(directions: Floats) -> PerspectiveGeometry:
    """View towards the middle of some directions."""
    x, y, z = directions.reshape(-1, 3).mean(axis=0)
    return PerspectiveGeometry(
        VIEW_PX,
        VIEW_PX,
        2.0 * math.atan(0.5 * VIEW_PX / FOCAL_PX),
        math.atan2(y, x),
        -math.atan2(z, math.hypot(x, y)),
    )


def off_line_px(points: Floats) -> Floats:
    """(n,) distances of (n, 2) points from the line nearest to them."""
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred)
    distances: Floats = np.abs(centred @ axes[1])
    return distances


def test_rows_of_boards_are_straight_in_unwrapped_photographs(
    photographs: list[Pixels], camera: OmniCamera
) -> None:
    assert camera.picture is Picture.MIRRORED
    rms_px, bows_px = [], []
    for photograph in photographs:
        corners = find_board(photograph)
        if corners is None:
            continue
        directions, seen = camera.direction_from_pixel(corners)
        assert seen.all()
        view = unwarp(photograph, make_unwarp_map(camera, facing_view(directions)))
        board = find_board(view)
        if board is None:
            continue
        for row in (*board, *board.transpose(1, 0, 2)):
            distances = off_line_px(row)
            rms_px.append(math.sqrt(float(np.square(distances).mean())))
            bows_px.append(float(distances.max()))
    assert len(rms_px) >= 18 * 12
    assert math.sqrt(float(np.square(rms_px).mean())) <= 0.35
    assert np.mean(np.array(bows_px) <= 0.7) >= 0.8


def test_boards_are_seen_again_where_they_were(
    photographs: list[Pixels], camera: OmniCamera
) -> None:
    squares, num_boards = [], 0
    for photograph in photographs:
        corners = find_board(photograph)
        if corners is None:
            continue
        num_boards += 1
        directions, _ = camera.direction_from_pixel(corners)
        squares.append(np.square(_reprojection_px(camera, corners, directions)))
    assert num_boards >= 15
    assert math.sqrt(float(np.mean(squares))) <= 0.6


def _reprojection_px(camera: OmniCamera, corners: Floats, directions: Floats) -> Floats:
    """(77,) distances of corners from those of a rigid board, by the pose that fits best."""
    middle = directions.reshape(-1, 3).mean(axis=0)
    middle /= np.linalg.norm(middle)
    right = np.cross((0.0, 0.0, 1.0), middle)
    right /= np.linalg.norm(right)
    view = np.stack((right, np.cross(middle, right), middle))
    rays = directions.reshape(-1, 3) @ view.T
    plane = rays[:, :2] / rays[:, 2:]
    # Of a plane; the corners are found in the order of a mirrored board: one seen from behind.
    _, turn, shift = cv2.solvePnP(board_points(), plane, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    pose = np.concatenate((turn.ravel(), shift.ravel()))

    def errors(pose: Floats) -> Floats:
        rotation, _ = cv2.Rodrigues(pose[:3])
        points = (board_points() @ rotation.T + pose[3:]) @ view
        pixels, _ = camera.pixel_from_direction(points)
        return (pixels - corners.reshape(-1, 2)).ravel()

    for _ in range(20):
        error = errors(pose)
        steps = 1e-6 * np.eye(6)
        jacobian = np.stack([(errors(pose + step) - error) / 1e-6 for step in steps], axis=-1)
        pose = pose - np.linalg.lstsq(jacobian, error, rcond=None)[0]
    distances: Floats = np.linalg.norm(errors(pose).reshape(-1, 2), axis=1)
    return distances
