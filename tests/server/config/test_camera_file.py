"""Camera files: texts, kinds, and the robots that carry their cameras."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError, ConfigError
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.camera_file import carry_camera, read_camera_file, read_camera_files
from catoptra_server.config.known_names import bundled_files
from helpers.configs import REPOSITORY

CAMERAS = REPOSITORY / "configs/cameras"


@pytest.mark.parametrize("path", sorted(CAMERAS.glob("*.ini")), ids=lambda path: path.stem)
def test_bundled_camera_names_its_source_and_can_be_carried(path: Path, tmp_path: Path) -> None:
    file = read_camera_file(path)
    assert file.title
    assert file.source
    assert file.licence
    camera = carry_camera(file, tmp_path / "robot.ini", size_px=90).camera
    assert camera.has_mirror != file.is_lens
    assert (camera.width_px == 90) != file.keeps_size


def test_no_name_stands_for_all_bundled_cameras() -> None:
    assert len(read_camera_files([])) == len(bundled_files("cameras")) >= 8


def test_lens_hangs_at_the_viewpoint_of_the_mirror_and_looks_down(tmp_path: Path) -> None:
    lens, mirror = (
        carry_camera(file, tmp_path / f"{file.name}.ini")
        for file in read_camera_files(["equidistant_220", "paper"])
    )
    for part in ("translation", "rotation"):
        np.testing.assert_allclose(
            getattr(lens.robot_from_mirror, part),
            getattr(mirror.robot_from_mirror, part),
            atol=1e-6,
        )
    assert lens.camera.picture is Picture.FLIPPED
    assert math.degrees(lens.camera.rim_rad) == pytest.approx(110.0)


def test_camera_without_a_title_is_rejected_with_its_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.ini"
    path.write_text("[Camera]\nItemClass=Catoptra.Mine\n[Catoptra.Mine]\nLens=equidistant\n")
    with pytest.raises(ConfigError, match=r"mine\.ini.*Title"):
        read_camera_file(path)


def test_calibration_in_pixels_keeps_its_size(tmp_path: Path) -> None:
    path = tmp_path / "mine.ini"
    path.write_text(
        "[Camera]\nItemClass=Catoptra.Mine\nTitle=a\nSource=b\nLicence=c\n[Catoptra.Mine]\n"
        "Lens=equidistant\nFocalLength=50\nResolutionX=200\nResolutionY=100\nFieldOfView=180\n"
    )
    camera = carry_camera(read_camera_file(path), tmp_path / "robot.ini", size_px=90).camera
    assert (camera.width_px, camera.height_px, camera.scale_px) == (200, 100, 50.0)


def test_two_cameras_of_one_name_are_rejected() -> None:
    with pytest.raises(CatoptraError, match="one name"):
        read_camera_files(["paper", "paper"])


def test_robot_without_a_mirror_cannot_carry_a_camera(tmp_path: Path) -> None:
    (file,) = read_camera_files(["paper"])
    with pytest.raises(CatoptraError, match="no mirror"):
        carry_camera(file, tmp_path / "robot.ini", base_robot="p2at")
