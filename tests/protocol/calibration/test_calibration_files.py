"""Cameras from files and folders of calibrations."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.calibration_folder import REPORT_NAME, write_calibration
from catoptra_protocol.calibration.exports import EXPORTS
from catoptra_protocol.calibration.files import MAX_BYTES
from catoptra_protocol.calibration.formats import FORMATS, kalibr
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import LAFIDA, PAPER, TUM_VI_KB, WOODSCAPE


def test_each_format_is_recognized_as_itself_alone() -> None:
    for camera in (PAPER, TUM_VI_KB, LAFIDA, WOODSCAPE):
        for each in FORMATS:
            try:
                text = each.write(camera, "omni")
            except DomainError:
                continue
            assert [one.NAME for one in FORMATS if one.is_format(text)] == [each.NAME]


def test_formats_state_their_conventions() -> None:
    for each in FORMATS:
        assert each.CONVENTIONS.first_pixel == 0.0
        assert all((each.CONVENTIONS.frame, each.CONVENTIONS.fields))


def test_hand_of_the_delivered_picture_is_the_caller_s(tmp_path: Path) -> None:
    path = tmp_path / kalibr.FILE_NAME
    path.write_text(kalibr.write(PAPER, "omni"))
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
    ("camera_model: omni", "camera_model: wide", "one of omni, eucm, ds, pinhole"),
    ("intrinsics: [0.99", "intrinsics: [.nan, 0.99", "intrinsics="),
    ("intrinsics: [0.99", "intrinsics: [-0.99", "xi >= 0"),
    ("102.98", "-102.98", "fu and fv above 0"),
    ("179.5", "1.0e+7", "far outside"),
    ("distortion_coeffs: []", "distortion_coeffs: [1.0]", "distortion_coeffs="),
]


@pytest.mark.parametrize(("old", "new", "message"), CHANGES)
def test_wrong_field_is_rejected_with_path_and_expectation(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = kalibr.write(PAPER, "omni")
    assert old in text
    path = tmp_path / "camchain.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=rf"camchain\.yaml: cam0\..*{message}"):
        camera_from_file(path)


def test_each_file_has_a_line_and_each_line_a_file_or_a_reason(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    lines = write_calibration(PAPER, folder, name="cam", picture=Picture.MIRRORED)
    assert len(lines) == len(EXPORTS) + 2
    written = {line.split(": ")[0] for line in lines if not line.startswith("not written")}
    assert written == {str(path) for path in folder.iterdir()}
    assert "mirrored world" in (folder / REPORT_NAME).read_text()


def test_smaller_residual_leaves_out_what_was_fitted(tmp_path: Path) -> None:
    lines = write_calibration(PAPER, tmp_path, name="cam", max_residual_px=1e-6)
    refused = [line for line in lines if line.startswith("not written")]
    assert len(refused) == 4
    assert not (tmp_path / "ocamcalib.txt").exists()


@pytest.mark.parametrize("residual_px", [-1.0, math.nan, math.inf])
def test_impossible_residual_is_refused_before_anything_is_written(
    residual_px: float, tmp_path: Path
) -> None:
    with pytest.raises(DomainError, match="a residual is 0 px or more"):
        write_calibration(PAPER, tmp_path / "new", name="cam", max_residual_px=residual_px)
    assert not (tmp_path / "new").exists()
