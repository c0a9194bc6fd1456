"""Kalibr's camchains: its four models by their published formulas, and chains of cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.formats import kalibr
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from helpers.calibrated_cameras import (
    PAPER,
    THETA_BACK,
    TUM_VI,
    TUM_VI_KB,
    assert_written_and_read,
    flipped_points,
)


def project(values: dict[str, Any], points: Floats) -> Floats:
    """Pixels of unit points by Kalibr's models."""
    *shape, fu, fv, pu, pv = values["intrinsics"]
    x, y, z = points.T
    if values["camera_model"] == "omni":
        m = np.stack((x, y)) / (z + shape[0])
    elif values["camera_model"] == "ds":
        xi, alpha = shape
        d2 = np.sqrt(x * x + y * y + (xi + z) ** 2)
        m = np.stack((x, y)) / (alpha * d2 + (1.0 - alpha) * (xi + z))
    else:
        k1, k2, k3, k4 = values["distortion_coeffs"]
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        s = theta * theta
        radius = theta * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
        m = np.stack((x, y)) * radius / np.where(rho > 0.0, rho, 1.0)
    return np.stack((fu * m[0] + pu, fv * m[1] + pv), axis=-1)


@pytest.mark.parametrize("camera", [PAPER, TUM_VI, TUM_VI_KB])
def test_file_is_the_published_model(tmp_path: Path, camera: OmniCamera) -> None:
    values = yaml.safe_load(assert_written_and_read(kalibr, camera, tmp_path))["cam0"]
    assert all(isinstance(number, float) for number in values["intrinsics"])
    points, expected, valid = flipped_points(camera)
    assert np.abs(project(values, points) - expected)[valid].max() <= 1e-9


def test_camera_of_a_chain_is_found_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "chain.yaml"
    second = kalibr.write(TUM_VI, "right").replace("cam0:", "cam1:")
    path.write_text(kalibr.write(PAPER, "left") + second)
    assert camera_from_file(path).width_px == 360
    assert camera_from_file(path, camera="cam1").width_px == 512
    with pytest.raises(ConfigError, match=r"cam2=.*missing"):
        camera_from_file(path, camera="cam2")


def test_skew_and_a_flat_image_have_no_place(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match="skew"):
        kalibr.write(THETA_BACK, "omni")
    path = tmp_path / "flat.yaml"
    path.write_text(
        "cam0:\n  camera_model: pinhole\n  intrinsics: [1.0, 1.0, 2.0, 2.0]\n"
        "  distortion_model: radtan\n  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n"
        "  resolution: [4, 4]\n"
    )
    with pytest.raises(ConfigError, match=r"distortion_model=.*an ordinary camera"):
        camera_from_file(path)
