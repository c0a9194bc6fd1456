"""BoofCV's files: numbers with decimal points, the published formula."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from catoptra_protocol.calibration.formats import boofcv
from catoptra_protocol.optics.omni_camera import OmniCamera
from helpers.calibrated_cameras import PAPER, THETA_BACK, assert_written_and_read, flipped_points


@pytest.mark.parametrize("camera", [PAPER, THETA_BACK])
def test_file_is_the_universal_model(tmp_path: Path, camera: OmniCamera) -> None:
    values = yaml.safe_load(assert_written_and_read(boofcv, camera, tmp_path))
    k, d = values["pinhole"], values["radial_tangential"]
    points, expected, valid = flipped_points(camera)
    x, y = points[:, :2].T / (points[:, 2] + values["mirror_offset"])
    squared = x * x + y * y
    gain = 1.0 + d["radial"][0] * squared + d["radial"][1] * squared**2
    dx = gain * x + 2.0 * d["t1"] * x * y + d["t2"] * (squared + 2.0 * x * x)
    dy = gain * y + d["t1"] * (squared + 2.0 * y * y) + 2.0 * d["t2"] * x * y
    found = np.stack((k["fx"] * dx + k["skew"] * dy + k["cx"], k["fy"] * dy + k["cy"]), axis=-1)
    assert np.abs(found - expected)[valid].max() <= 1e-9


def test_focal_lengths_and_centre_have_a_decimal_point() -> None:
    text = boofcv.write(PAPER, "omni")
    assert re.findall(r"  (?:fx|fy|cx|cy): ([0-9]+)$", text, re.MULTILINE) == []
