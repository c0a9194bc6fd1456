"""Basalt's files: its models by their published formulas."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.formats import basalt
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from helpers.calibrated_cameras import (
    PAPER,
    THETA_BACK,
    TUM_VI,
    TUM_VI_KB,
    assert_written_and_read,
    flipped_points,
)


@pytest.mark.parametrize(("camera", "kind"), [(PAPER, "ucm"), (TUM_VI, "ds"), (TUM_VI_KB, "kb4")])
def test_file_is_the_published_model(tmp_path: Path, camera: OmniCamera, kind: str) -> None:
    text = assert_written_and_read(basalt, camera, tmp_path)
    entry = json.loads(text)["value0"]["intrinsics"][0]
    assert entry["camera_type"] == kind
    points, expected, valid = flipped_points(camera)
    k, (x, y, z) = entry["intrinsics"], points.T
    rho = np.hypot(x, y)
    if kind == "ucm":
        m = 1.0 / (k["alpha"] + (1.0 - k["alpha"]) * z)
    elif kind == "ds":
        d2 = np.sqrt(rho**2 + (k["xi"] + z) ** 2)
        m = 1.0 / (k["alpha"] * d2 + (1.0 - k["alpha"]) * (k["xi"] + z))
    else:
        s = np.arctan2(rho, z) ** 2
        radius = np.sqrt(s) * (1 + s * (k["k1"] + s * (k["k2"] + s * (k["k3"] + s * k["k4"]))))
        m = radius / np.where(rho > 0.0, rho, 1.0)
    found = np.stack((k["fx"] * m * x + k["cx"], k["fy"] * m * y + k["cy"]), axis=-1)
    assert np.abs(found - expected)[valid].max() <= 1e-9


def test_distortion_has_no_place() -> None:
    with pytest.raises(DomainError, match="distortion"):
        basalt.write(THETA_BACK, "omni")


def test_camera_that_the_file_has_not_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "one.json"
    path.write_text(basalt.write(PAPER, "omni"))
    for name in ("cam1", "left"):
        with pytest.raises(ConfigError, match=rf"{name}=.*which has cam0"):
            camera_from_file(path, camera=name)
