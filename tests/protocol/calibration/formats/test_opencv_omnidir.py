"""OpenCV's omnidir files: read by OpenCV itself, and projected by its own function."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from catoptra_protocol.calibration.formats import opencv_omnidir
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from helpers.calibrated_cameras import (
    PAPER,
    THETA_BACK,
    TUM_VI_KB,
    assert_written_and_read,
    flipped_points,
)


@pytest.mark.parametrize("camera", [PAPER, THETA_BACK])
def test_file_is_read_and_projected_by_opencv(tmp_path: Path, camera: OmniCamera) -> None:
    text = assert_written_and_read(opencv_omnidir, camera, tmp_path)
    assert text.startswith("%YAML")
    storage = cv2.FileStorage(str(tmp_path / opencv_omnidir.NAME), cv2.FILE_STORAGE_READ)
    k, d = storage.getNode("K").mat(), storage.getNode("D").mat()
    xi = storage.getNode("xi").real()
    points, expected, valid = flipped_points(camera)
    at_rest = np.zeros(3)
    found, _ = cv2.omnidir.projectPoints(points[None], at_rest, at_rest, k, xi, d)
    # The rim itself may be outside by a rounding.
    assert valid.sum() >= 99_900
    assert np.abs(found[0] - expected)[valid].max() <= 1e-9


def test_camera_that_is_no_sphere_has_no_file() -> None:
    with pytest.raises(DomainError, match="no unified sphere"):
        opencv_omnidir.write(TUM_VI_KB, "omni")
