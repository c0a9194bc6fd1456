"""OCamCalib's files: both polynomials, the affine matrix, the axis that points away."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.formats import ocamcalib
from catoptra_protocol.errors import ConfigError, DomainError
from helpers.calibrated_cameras import LAFIDA, PAPER, assert_written_and_read, flipped_points


def test_file_s_polynomials_project_both_ways(tmp_path: Path) -> None:
    text = assert_written_and_read(ocamcalib, LAFIDA, tmp_path)
    rows = [line.split() for line in text.splitlines() if line and line[0] != "#"]
    terms, inverse, (row, column), (c, d, e) = (
        [float(word) for word in line] for line in (rows[0][1:], rows[1][1:], rows[2], rows[3])
    )
    assert terms[0] < 0.0
    points, expected, valid = flipped_points(LAFIDA)
    # Their frame: x down the rows, y along the columns, z away from the scene.
    x, y, z = points[:, 1], points[:, 0], -points[:, 2]
    rho = np.hypot(x, y)
    off_axis = valid & (rho > 1e-9)
    image_radius = np.polynomial.polynomial.polyval(np.arctan2(z, rho), inverse)
    plane = image_radius * np.stack((x, y)) / np.where(rho > 0.0, rho, 1.0)
    v = c * plane[0] + d * plane[1] + row
    u = e * plane[0] + plane[1] + column
    error = np.abs(np.stack((u, v), axis=-1) - expected)[off_axis]
    assert error.max() <= 5e-4
    # And back: the ray of an image radius.
    back = np.polynomial.polynomial.polyval(image_radius, terms)
    turn = np.arctan2(image_radius, back) - np.arctan2(rho, z)
    assert np.abs(turn[off_axis]).max() <= 1e-5


def test_polynomial_is_in_pixels_of_the_image_s_size(tmp_path: Path) -> None:
    double = replace(LAFIDA, width_px=1508, height_px=960, centre_px=(740.0, 480.0), scale_px=2.0)
    assert_written_and_read(ocamcalib, double, tmp_path)


def test_camera_of_another_model_has_no_file() -> None:
    with pytest.raises(DomainError, match="no polynomial of rays"):
        ocamcalib.write(PAPER, "omni")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("5 -209", "4 -209", "polynomial=.*number of terms"),
        ("-209.2008", "209.2008", "a0 must be above 0"),
        ("480 754", "480.5 754", "size=.*whole numbers"),
    ],
)
def test_bad_file_is_rejected_with_its_field(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "calib_results.txt"
    text = ocamcalib.write(LAFIDA, "omni")
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=message):
        camera_from_file(path)
