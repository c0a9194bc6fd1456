"""A camera as files of all formats: each read again, refused ones with their number."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.exports import (
    ExportedFile,
    RefusedFile,
    _fit_and_compare,
    export_camera,
)
from catoptra_protocol.calibration.formats import FORMATS, FRONT, CalibrationFormat, find_format
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import PAPER, THETA_BACK, TUM_VI

EXACT = {
    *("opencv_omnidir", "camodocal", "boofcv", "kalibr_omni", "kalibr_eucm", "kalibr_ds"),
    *("basalt_ucm", "basalt_eucm", "basalt_ds", "maplab_unified", "fca_ucm", "fca_eucm", "fca_ds"),
}
# Readers of the others take directions in front alone.
WHOLE = [one for one in FORMATS if one.domain != FRONT]


def export(
    camera: OmniCamera, one: CalibrationFormat, picture: Picture = Picture.FLIPPED, **limit: float
) -> ExportedFile | RefusedFile:
    return export_camera(camera, one, name="cam", picture=picture, **limit)


def test_camera_is_compared_with_each_model_once() -> None:
    for known in (compute_residual, _fit_and_compare):
        known.cache_clear()
    for one in FORMATS:
        export(THETA_BACK, one)
    # Of nine models, some without skew or p1 and p2, and five degrees of OCam's polynomial.
    assert compute_residual.cache_info().misses == 18


def read_again(file: ExportedFile, folder: Path, picture: Picture | None = None) -> OmniCamera:
    path = folder / file.export.file_name
    path.write_text(file.text)
    return camera_from_file(path, picture=picture, size_px=(360, 360))


@pytest.mark.parametrize("picture", list(Picture))
@pytest.mark.parametrize("one", WHOLE, ids=lambda one: one.name)
def test_file_of_the_paper_s_camera_is_the_camera(
    one: CalibrationFormat, picture: Picture, tmp_path: Path
) -> None:
    result = export(PAPER, one, picture)
    if isinstance(result, RefusedFile):
        assert one.name in ("woodscape", "py_omnicalib")
        assert result.reason == "off by up to 0.756 px"
        return
    back = read_again(result, tmp_path)
    assert back.picture is picture
    assert (back.width_px, back.height_px) == (360, 360)
    found = compute_residual(PAPER, back)
    assert found.max_px == pytest.approx(result.residual.max_px, abs=1e-9)
    assert found.max_px <= (1e-9 if one.name in EXACT else 0.05)


@pytest.mark.parametrize("picture", list(Picture))
@pytest.mark.parametrize(
    "one", [find_format("opencv_omnidir"), find_format("boofcv")], ids=lambda one: one.name
)
def test_skew_and_decentring_survive_both_hands(
    one: CalibrationFormat, picture: Picture, tmp_path: Path
) -> None:
    result = export(THETA_BACK, one, picture)
    assert isinstance(result, ExportedFile)
    back = read_again(result, tmp_path)
    assert back.picture is picture
    # Directions of pixels of the delivered picture are those of the camera itself.
    pixels = np.random.default_rng(1).uniform((150.0, 150.0), (800.0, 900.0), (2000, 2))
    truth, seen = THETA_BACK.with_picture(picture).direction_from_pixel(pixels)
    found, known = back.direction_from_pixel(pixels)
    assert (seen & known).sum() > 1000
    assert found[seen & known] == pytest.approx(truth[seen & known], abs=1e-11)


@pytest.mark.parametrize("picture", list(Picture))
@pytest.mark.parametrize("one", WHOLE, ids=lambda one: one.name)
def test_file_of_the_other_hand_is_an_error_and_not_a_mirror_image(
    one: CalibrationFormat, picture: Picture, tmp_path: Path
) -> None:
    result = export(PAPER, one, picture, max_residual_px=2.0)
    assert isinstance(result, ExportedFile)
    other = Picture.FLIPPED if picture is Picture.MIRRORED else Picture.MIRRORED
    with pytest.raises(ConfigError, match=rf"a file of {other.value} pictures"):
        read_again(result, tmp_path, other)
    assert read_again(result, tmp_path, picture).picture is picture


def test_allowed_residual_decides_what_is_refused() -> None:
    one = find_format("basalt_kb4")
    assert isinstance(export(PAPER, one), ExportedFile)
    refused = export(PAPER, one, max_residual_px=0.01)
    assert isinstance(refused, RefusedFile)
    assert refused.reason == "off by up to 0.0246 px"


def test_format_without_a_place_for_skew_is_refused_by_what_that_costs() -> None:
    one = find_format("kalibr_omni")
    refused = export(THETA_BACK, one)
    assert isinstance(refused, RefusedFile)
    assert refused.reason == "off by up to 0.968 px"


def test_polynomial_of_rays_takes_as_many_terms_as_it_needs() -> None:
    one = find_format("ocamcalib")
    few, many = export(PAPER, one), export(TUM_VI, one)
    assert isinstance(few, ExportedFile)
    assert isinstance(many, ExportedFile)
    lengths = [file.text.splitlines()[1].split()[0] for file in (few, many)]
    assert lengths[0] == "5"
    assert int(lengths[1]) > 5


def test_reader_of_directions_in_front_has_no_file_of_a_wider_image() -> None:
    refused = export(PAPER, find_format("kalibr_equi"))
    assert isinstance(refused, RefusedFile)
    assert "z > 0 alone, and this image shows 240.000 deg" in refused.reason


def test_mirror_without_a_viewpoint_has_no_file() -> None:
    ball = camera_with_inscribed_rim(
        SphericalMirror(0.03, 0.2), width_px=360, height_px=360, rim_rad=math.radians(120.0)
    )
    results = [export(ball, one) for one in FORMATS]
    assert all(isinstance(result, RefusedFile) for result in results)
    assert all("viewpoint" in result.reason for result in results)  # type: ignore[union-attr]


def test_text_is_the_same_each_time() -> None:
    for one in FORMATS:
        assert export(PAPER, one) == export(PAPER, one)


# The focal length of each format's file, or what stands for it.
FOCAL = re.compile(r"-?\d\d+\.\d{4,}")


@pytest.mark.parametrize("one", WHOLE, ids=lambda one: one.name)
@pytest.mark.parametrize("fault", ["cut", "nan", "negative"])
def test_damaged_file_is_an_error_with_its_name(
    one: CalibrationFormat, fault: str, tmp_path: Path
) -> None:
    result = export(PAPER, one, max_residual_px=2.0)
    assert isinstance(result, ExportedFile)
    text = result.text
    if one.name == "camodocal_scaramuzza" and fault == "negative":
        text = text.replace("p0: 51", "p0: 0 #")  # its polynomial may have either sign
    match fault:
        case "cut":
            text = text[: len(text) // 3]
        case "nan":
            # YAML's word for it is another one.
            word = ".nan" if one.file_name.endswith("yaml") else "NaN"
            text = FOCAL.sub(word, text, count=1)
        case _:
            text = FOCAL.sub(lambda found: str(-float(found[0])), text, count=1)
    path = tmp_path / one.file_name
    path.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(str(path))) as raised:
        camera_from_file(path)
    assert "expected" in str(raised.value)
