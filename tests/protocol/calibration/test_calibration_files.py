"""Cameras from files and folders of calibrations, and CALIBRATION.md about them."""

from __future__ import annotations

import math
import re
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.calibration_folder import REPORT_NAME, write_calibration
from catoptra_protocol.calibration.files import MAX_BYTES
from catoptra_protocol.calibration.formats import FORMATS, FRONT, WOODSCAPE, find_format
from catoptra_protocol.calibration.model_fits import fit_mei
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from helpers.calibrated_cameras import PAPER, THETA_BACK


def test_hand_of_the_delivered_picture_is_the_caller_s(tmp_path: Path) -> None:
    path = tmp_path / "kalibr.yaml"
    path.write_text(find_format("kalibr_omni").write(fit_mei(PAPER), "omni"))
    flipped, mirrored = (camera_from_file(path, picture=picture) for picture in Picture)
    assert (flipped.picture, mirrored.picture) == (Picture.MIRRORED, Picture.FLIPPED)
    assert flipped.with_picture(Picture.FLIPPED) == mirrored


BAD = [
    (b"", "format"),
    (b"hello", "format"),
    (b"\xff\xfe\x00", "UTF-8"),
    (b"x" * (MAX_BYTES + 1), "size="),
    (b'{"value0": {"camera_type"', "JSON"),
    (b"cam0: {camera_model: omni, distortion_model: [", "YAML"),
    (b"a: &a [1]\nb: *a\ncamera_model: x\ndistortion_model: y\n", "aliases"),
    (b"[" * 5000 + b"camera_model distortion_model", "YAML"),
]


@pytest.mark.parametrize(("data", "message"), BAD)
def test_file_that_is_none_is_rejected_with_its_name(
    tmp_path: Path, data: bytes, message: str
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_bytes(data)
    with pytest.raises(ConfigError, match=rf"bad\.yaml.*{message}"):
        camera_from_file(path)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml.*a readable file"):
        camera_from_file(tmp_path / "none.yaml")


CHANGES = [
    ("resolution: [360, 360]", "resolution: [360]", "resolution="),
    ("resolution: [360, 360]", "resolution: [360, 1e9]", "resolution="),
    ("intrinsics: [0.99", "intrinsics: [.nan, 0.99", "intrinsics="),
    ("intrinsics: [0.99", "intrinsics: [-0.99", "xi >= 0"),
    ("102.98", "-102.98", "focal lengths must be above 0"),
    ("179.5", "1.0e+7", "far outside"),
    ("distortion_coeffs: [0.0", "distortion_coeffs: [a", "distortion_coeffs="),
    ("camera_model: omni", "camera_model: wide", "omni: the file is of the format kalibr_omni"),
    ("distortion_model: radtan", "no_model: radtan", "distortion_model='missing'"),
]


@pytest.mark.parametrize(("old", "new", "message"), CHANGES)
def test_wrong_field_is_rejected_with_path_and_expectation(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = find_format("kalibr_omni").write(fit_mei(PAPER), "omni")
    assert old in text
    path = tmp_path / "camchain.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=rf"camchain\.yaml: cam0\..*{message}"):
        camera_from_file(path)


def test_each_file_has_a_line_and_each_line_a_file_or_a_reason(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    lines = write_calibration(PAPER, folder, name="cam", picture=Picture.MIRRORED)
    assert len(lines) == len(FORMATS) + 2
    written = {line.split(": ")[0] for line in lines if not line.startswith("not written")}
    assert written == {str(path) for path in folder.iterdir()}
    assert "mirrored world" in (folder / REPORT_NAME).read_text()


def test_smaller_residual_leaves_out_what_was_fitted(tmp_path: Path) -> None:
    lines = write_calibration(PAPER, tmp_path, name="cam", max_residual_px=1e-6)
    refused = [line for line in lines if line.startswith("not written")]
    assert all("z > 0" in line or "off by" in line for line in refused)
    assert len(refused) == len(FORMATS) - 13
    assert not (tmp_path / "ocamcalib.txt").exists()


@pytest.mark.parametrize("residual_px", [-1.0, math.nan, math.inf])
def test_impossible_residual_is_refused_before_anything_is_written(
    residual_px: float, tmp_path: Path
) -> None:
    with pytest.raises(DomainError, match="a residual is 0 px or more"):
        write_calibration(PAPER, tmp_path / "new", name="cam", max_residual_px=residual_px)
    assert not (tmp_path / "new").exists()


@lru_cache
def report(camera: OmniCamera, picture: Picture = Picture.FLIPPED) -> str:
    """Report of a folder of calibration files."""
    rotation = Pose.identity().rotation
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_calibration(camera, folder, name="cam", picture=picture, robot_from_mirror=rotation)
        return (folder / REPORT_NAME).read_text()


def test_report_names_each_file_once_with_its_residual_and_domains() -> None:
    text = report(PAPER)
    for one in FORMATS:
        is_written = one.domain != FRONT and one.model is not WOODSCAPE
        assert text.count(f"| {one.file_name} |") == is_written
    assert re.search(r"\| basalt_kb4.json \|.*\| 0.025 \|.*\| none \| 180.000 deg \|", text)
    assert "* polynomial of the angle (woodscape): off by up to 0.756 px" in text
    assert "* NVIDIA's f-theta of degree 4: off by up to 0.47 px" in text
    assert "up to 120.000 deg" in text


def test_report_states_the_conventions_of_each_format() -> None:
    text = report(PAPER)
    for each in FORMATS:
        row = f"| {each.name} | {each.program} | {each.frame} | {each.first_pixel:g} |"
        assert text.count(row) == 1
    assert "pinhole; intrinsics [fx fy cx cy]; distortion_model equidistant;" in text
    assert "| ray table | | x right, y down, z along the optical axis | 0.5 |" in text


def test_fold_of_a_published_calibration_is_stated() -> None:
    assert "its first fold" in report(THETA_BACK)


@pytest.mark.parametrize("picture", list(Picture))
def test_worked_points_are_pixels_of_the_published_formula(picture: Picture) -> None:
    rows = re.findall(
        r"^\| ([\d.]+) \| ([-\d., ]+) \| ([-\d., ]+) \| ([-\d., ]+) \|$",
        report(PAPER, picture),
        re.MULTILINE,
    )
    assert [float(row[0]) for row in rows] == pytest.approx((30.0, 90.0, 119.88))
    for _, ray, first_zero, first_half in rows:
        x, y, z = (float(value) for value in ray.split(","))
        xi, gamma = 0.9954941783, 102.98653100
        expected = (gamma * x / (z + xi) + 179.5, gamma * y / (z + xi) + 179.5)
        found = [float(value) for value in first_zero.split(",")]
        assert found == pytest.approx(expected, abs=2e-5)
        assert [float(value) for value in first_half.split(",")] == pytest.approx(
            np.add(found, 0.5)
        )


def test_axes_in_the_carrier_s_frame_are_those_of_the_picture() -> None:
    text = report(PAPER)
    axes = np.array(
        [
            [float(value) for value in row.split(",")]
            for row in re.findall(r"^\| [xyz] \| (.*) \|$", text, re.MULTILINE)
        ]
    )
    assert np.cross(axes[0], axes[1]) == pytest.approx(axes[2])
    flipped = PAPER.with_picture(Picture.FLIPPED)
    ray = axes.T @ (math.sin(1.0), 0.0, math.cos(1.0))
    pixel, _ = flipped.pixel_from_direction(ray)
    assert pixel[0] > 230.0
    assert pixel[1] == pytest.approx(180.0)


def test_mirrored_pictures_have_a_warning() -> None:
    assert "mirrored world" in report(PAPER, Picture.MIRRORED)
    assert "mirrored world" not in report(PAPER)
