"""Panoramas of a robot's camera, and the turn between two of them.

A panorama has a column for each azimuth in the robot frame. When the robot turns to the right, what
it sees moves to the left by the same angle: a mirrored picture, one with its rows upside down, and
one that shows an earlier moment do not agree with that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from conformance.check import CheckFailed, CheckSkipped

Floats = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.uint8]

_NUM_COLUMNS = 180
_COLUMN_RAD = math.tau / _NUM_COLUMNS
# Above the floor next to the robot, and below the rim of usual mirrors.
_ELEVATIONS_RAD = np.radians(np.linspace(-35.0, 15.0, 26))
# Far enough for the sense to show, in tenths of a second.
_TURN_RAD = 0.4
# Of the angle turned, for the parallax of what is near; the opposite sense differs by 2.
_TURN_TOLERANCE = 0.4
# Two columns of the panorama.
_COLUMN_TOLERANCE = 2.0
# A turn is wrong if another one fits this much better than each that agrees.
_MIN_CONTRAST = 1.5
# Mean difference in grey levels of a panorama and of the same one turned, from which a turn shows;
# below are noise, coding, and the grid of the pixels, which turns with the robot.
_MIN_TURN_LEVELS = 6.0
# Two panoramas must have this part of their directions in common to be compared.
_MIN_OVERLAP = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Panorama:
    """Colours by elevation and azimuth in the robot frame."""

    levels: Floats
    """(rows, columns, 3)."""
    valid: npt.NDArray[np.bool_]
    """(rows, columns): whether the camera sees this direction."""


def panorama_from_picture(
    rgb: Pixels, camera: OmniCamera | PerspectiveCamera, robot_from_camera: Floats | None = None
) -> Panorama:
    """Panorama of a picture.

    Args:
        rgb: (h, w, 3) picture.
        camera: Camera model of the picture.
        robot_from_camera: Rotation (3, 3); None: none, as of an upright camera.

    Raises:
        CheckFailed: The picture has not the size of the camera model.
    """
    if rgb.shape[:2] != (camera.height_px, camera.width_px):
        raise CheckFailed(
            f"a picture of {rgb.shape[1]} x {rgb.shape[0]} px; its camera model states "
            f"{camera.width_px} x {camera.height_px} px"
        )
    azimuths = _COLUMN_RAD * np.arange(_NUM_COLUMNS)
    elevation, azimuth = np.meshgrid(_ELEVATIONS_RAD, azimuths, indexing="ij")
    level = np.cos(elevation)
    directions = np.stack(
        (level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(elevation)), axis=-1
    )
    if robot_from_camera is not None:
        directions = directions @ robot_from_camera
    pixels, valid = project_directions(camera, directions)
    inside = (pixels >= 0.0).all(axis=-1) & (pixels < (camera.width_px, camera.height_px)).all(-1)
    # Pixel centres are at +0.5 in the camera model, at 0 in OpenCV.
    lookup = (pixels - 0.5).astype(np.float32)
    blurred = cv2.GaussianBlur(rgb, (0, 0), 1.0)
    levels = cv2.remap(blurred, lookup[..., 0], lookup[..., 1], cv2.INTER_LINEAR)
    return Panorama(levels.astype(np.float64), valid & inside)


def project_directions(
    camera: OmniCamera | PerspectiveCamera, directions: Floats
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Pixels (..., 2) of directions in the frame of a camera of either kind, and their validity."""
    if isinstance(camera, OmniCamera):
        return pixel_from_direction(camera, directions)
    return camera.pixel_from_direction(directions)


def project_points(
    camera: OmniCamera | PerspectiveCamera, points: Floats
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Pixels (..., 2) of points in the frame of a camera of either kind, and their validity.

    Rays of a mirror without a viewpoint begin at its surface: the distance counts, too.
    """
    if isinstance(camera, OmniCamera):
        return pixel_from_point(camera, points)
    return camera.pixel_from_direction(points)


def choose_turn(camera: OmniCamera | PerspectiveCamera) -> float:
    """Angle in radians that shows in pictures: far, but most of the view stays in view."""
    if isinstance(camera, OmniCamera):
        return _TURN_RAD
    return min(_TURN_RAD, 0.3 * camera.horizontal_fov_rad)


def require_turn(before: Panorama, after: Panorama, yaw_rad: float, evidence: str) -> None:
    """Fail where the pictures of a robot contradict a turn between them.

    Args:
        before: Panorama before the turn.
        after: Panorama after it.
        yaw_rad: Turn to the right.
        evidence: Where the turn is known from, for the reason.

    Raises:
        CheckFailed: Another shift of the panorama explains both pictures clearly better.
        CheckSkipped: Several shifts explain them.
    """
    expected = -yaw_rad / _COLUMN_RAD
    own_cost = _shift_costs(before, before).get(round(expected) % _NUM_COLUMNS)
    if own_cost is None:
        raise CheckSkipped(f"after a turn of {math.degrees(yaw_rad):.0f} deg all is out of view")
    if own_cost < _MIN_TURN_LEVELS:
        raise CheckSkipped("the surroundings look alike in all directions")
    costs = _shift_costs(before, after)
    width = _TURN_TOLERANCE * abs(expected) + _COLUMN_TOLERANCE
    near = [cost for shift, cost in costs.items() if _distance(shift, expected) <= width]
    best = min(costs, key=lambda shift: costs[shift])
    if _distance(best, expected) <= width:
        return
    if not near or min(near) <= _MIN_CONTRAST * costs[best]:
        raise CheckSkipped("the surroundings look alike before and after a turn")
    seen_deg = math.degrees(_COLUMN_RAD * math.remainder(best, _NUM_COLUMNS))
    raise CheckFailed(
        f"the robot turned by {math.degrees(yaw_rad):.0f} deg to the right ({evidence}): in its "
        f"picture the surroundings must move by {-math.degrees(yaw_rad):.0f} deg, to the left; "
        f"they moved by {seen_deg:.0f} deg"
    )


def _shift_costs(before: Panorama, after: Panorama) -> dict[int, float]:
    """Mean difference in grey levels of the panoramas by the shift of the first one, in columns."""
    costs = {}
    for shift in range(_NUM_COLUMNS):
        valid = np.roll(before.valid, shift, axis=1) & after.valid
        if valid.sum() < _MIN_OVERLAP * after.valid.sum():
            continue
        difference = np.abs(np.roll(before.levels, shift, axis=1) - after.levels)
        costs[shift] = float(difference[valid].mean()) if valid.any() else 0.0
    return costs


def _distance(shift: float, other: float) -> float:
    """Number of columns between two shifts, either way around."""
    return abs(math.remainder(shift - other, _NUM_COLUMNS))
