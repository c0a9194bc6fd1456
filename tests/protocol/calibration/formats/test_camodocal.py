"""CamOdoCal's files: the published formula, and what they cannot hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from catoptra_protocol.calibration.formats import camodocal
from catoptra_protocol.errors import DomainError
from helpers.calibrated_cameras import PAPER, THETA_BACK, assert_written_and_read, flipped_points


def test_file_is_mei_s_formula(tmp_path: Path) -> None:
    text = assert_written_and_read(camodocal, PAPER, tmp_path)
    values = yaml.safe_load(text.removeprefix("%YAML:1.0\n"))
    xi, plane = values["mirror_parameters"]["xi"], values["projection_parameters"]
    points, expected, valid = flipped_points(PAPER)
    depth = points[:, 2] + xi
    u = plane["gamma1"] * points[:, 0] / depth + plane["u0"]
    v = plane["gamma2"] * points[:, 1] / depth + plane["v0"]
    assert np.abs(np.stack((u, v), axis=-1) - expected)[valid].max() <= 1e-9


def test_skew_has_no_place() -> None:
    with pytest.raises(DomainError, match="skew"):
        camodocal.write(THETA_BACK, "omni")
