"""Panoramas of a synthetic camera: the turn that two pictures show."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import (
    camera_with_inscribed_rim,
    direction_from_pixel_grid,
)
from conformance.check import CheckFailed, CheckSkipped
from conformance.image_panorama import Pixels, panorama_from_picture, require_turn

CAMERA = camera_with_inscribed_rim(
    HyperbolicMirror(11.546, 0.2321), width_px=120, height_px=120, rim_rad=2.1
)
TURN_RAD = 0.5


def picture_at(yaw_rad: float) -> Pixels:
    """Picture of surroundings whose colour depends on the azimuth, by a robot with a heading."""
    centres = np.arange(120) + 0.5
    directions, valid = direction_from_pixel_grid(CAMERA, centres, centres)
    azimuth = np.arctan2(directions[..., 1], directions[..., 0]) + yaw_rad
    waves = [np.cos(azimuth), np.sin(3.0 * azimuth), np.cos(2.0 * azimuth + 1.0)]
    return np.where(valid[..., None], 128.0 + 100.0 * np.stack(waves, axis=-1), 0).astype(np.uint8)


def compare(after: Pixels) -> None:
    """Require that the second picture shows the turn."""
    panoramas = [panorama_from_picture(rgb, CAMERA) for rgb in (picture_at(0.3), after)]
    require_turn(*panoramas, TURN_RAD, "by construction")


def test_turn_when_the_picture_shows_it_passes() -> None:
    compare(picture_at(0.3 + TURN_RAD))


@pytest.mark.parametrize(
    "change",
    [
        lambda rgb: rgb[::-1].copy(),
        lambda rgb: rgb[:, ::-1].copy(),
        lambda rgb: rgb[::-1, ::-1].copy(),
        lambda rgb: picture_at(0.3),
        lambda rgb: picture_at(0.3 - TURN_RAD),
    ],
    ids=["upside down", "mirrored", "rotated", "stale", "opposite"],
)
def test_turn_when_the_picture_contradicts_it_fails(change: Callable[[Pixels], Pixels]) -> None:
    with pytest.raises(CheckFailed, match="must move by -29 deg, to the left"):
        compare(change(picture_at(0.3 + TURN_RAD)))


def test_turn_when_all_directions_look_alike_is_skipped() -> None:
    grey = panorama_from_picture(np.full((120, 120, 3), 90, np.uint8), CAMERA)
    with pytest.raises(CheckSkipped, match="alike in all directions"):
        require_turn(grey, grey, TURN_RAD, "by construction")


def test_panorama_of_another_size_than_the_model_fails() -> None:
    with pytest.raises(CheckFailed, match="its camera model states 120 x 120 px"):
        panorama_from_picture(np.zeros((64, 64, 3), np.uint8), CAMERA)
