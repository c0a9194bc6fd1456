"""WoodScape's files: the published formula, scaled images, other lenses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.formats import woodscape_json as woodscape
from catoptra_protocol.errors import DomainError
from helpers.calibrated_cameras import PAPER, WOODSCAPE, assert_written_and_read, flipped_points


def test_file_is_the_published_polynomial(tmp_path: Path) -> None:
    k = json.loads(assert_written_and_read(woodscape, WOODSCAPE, tmp_path))["intrinsic"]
    points, expected, valid = flipped_points(WOODSCAPE)
    x, y, z = points.T
    rho = np.hypot(x, y)
    theta = np.arctan2(rho, z)
    radius = sum(k[f"k{power}"] * theta**power for power in (1, 2, 3, 4))
    factor = radius / np.where(rho > 0.0, rho, 1.0)
    u = factor * x + 0.5 * k["width"] - 0.5 + k["cx_offset"]
    v = factor * y * k["aspect_ratio"] + 0.5 * k["height"] - 0.5 + k["cy_offset"]
    assert np.abs(np.stack((u, v), axis=-1) - expected)[valid].max() <= 1e-9


def test_polynomial_is_in_pixels_of_the_image_s_size(tmp_path: Path) -> None:
    half = replace(
        WOODSCAPE, width_px=640, height_px=483, centre_px=(321.971, 239.9535), scale_px=0.5
    )
    assert_written_and_read(woodscape, half, tmp_path)


def test_camera_of_another_model_has_no_file() -> None:
    with pytest.raises(DomainError, match="no polynomial of the angle"):
        woodscape.write(PAPER, "omni")
