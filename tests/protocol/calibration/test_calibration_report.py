"""CALIBRATION.md: its numbers are those of the camera."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_report import write_report
from catoptra_protocol.calibration.exports import EXPORTS, export_camera
from catoptra_protocol.calibration.formats import FORMATS
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from helpers.calibrated_cameras import PAPER, THETA_BACK


def report(camera: OmniCamera, picture: Picture = Picture.FLIPPED) -> str:
    results = [export_camera(camera, one, name="cam", picture=picture) for one in EXPORTS]
    rotation = Pose.identity().rotation
    return write_report(camera, results, name="cam", picture=picture, robot_from_mirror=rotation)


def test_report_names_each_file_once_with_its_residual_and_domains() -> None:
    text = report(PAPER)
    for one in EXPORTS:
        assert text.count(f"| {one.file_name} |") == (one.name != "woodscape")
    assert re.search(r"\| kalibr_equi.yaml \|.*\| 0.025 \|.*\| z > 0 \| 180.000 deg \|", text)
    assert "* polynomial of the angle (woodscape): off by up to 0.756 px" in text
    assert "* NVIDIA's f-theta of degree 4: off by up to 0.47 px" in text
    assert "up to 120.000 deg" in text


def test_report_states_the_conventions_of_each_format() -> None:
    text = report(PAPER)
    for each in FORMATS:
        row = f"| {each.NAME} | {each.CONVENTIONS.frame} | 0 | {each.CONVENTIONS.fields} |"
        assert text.count(row) == 1
    assert "| ray table | x right, y down, z along the optical axis | 0.5 |" in text


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
