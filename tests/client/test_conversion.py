"""`catoptra-client convert`: files of one program as files of another, and what that costs."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import pytest

from catoptra_client.__main__ import main
from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.formats import find_format
from catoptra_protocol.calibration.model_fits import compute_residual
from helpers.calibrated_cameras import TUM_VI, TUM_VI_KB


def write(folder: Path, name: str = "kalibr_equi") -> Path:
    path = folder / "source.yaml"
    camera = TUM_VI if name == "kalibr_ds" else TUM_VI_KB
    path.write_text(find_format(name).write(camera, "cam"))
    return path


def test_file_is_written_with_residual_domains_and_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = write(tmp_path), tmp_path / "out"
    words = ["convert", str(source), "--to", "basalt_ds", "--out", str(out)]
    assert main([*words, "--field-of-view", "180", "--max-residual-px", "0.1"]) == 0
    first, second, third = capsys.readouterr().out.splitlines()
    assert "kalibr_equi, KannalaBrandtLens, 512 x 512 px, up to 90.000 deg" in first
    assert re.search(r"basalt_ds, within 0\.0\d+ px .*; readers: z > -w2", second)
    assert "difference, yellow at 0.0" in third
    residual = compute_residual(TUM_VI_KB, camera_from_file(out / "basalt_ds.json"))
    assert 0.0 < residual.max_px < 1.0
    image = cv2.imread(str(out / "basalt_ds_difference.png"))
    assert image.shape == (317, 317, 3)
    # Nothing on the axis, yellow (blue, green, red here) somewhere, grey beyond the field.
    assert image[158, 158].max() < 80
    assert ((image == (0, 255, 255)).all(axis=-1)).any()
    assert image[0, 0].tolist() == [90, 90, 90]


def test_reader_of_directions_in_front_gets_them_and_the_rest_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write(tmp_path)
    assert main(["convert", str(source), "--to", "okvis2", "--out", str(tmp_path)]) == 0
    assert "readers: z > 0, which leave out what lies beyond 90 deg" in capsys.readouterr().out
    assert compute_residual(TUM_VI_KB, camera_from_file(tmp_path / "okvis2.yaml")).max_px < 1e-9


def test_without_a_format_all_are_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["convert", str(write(tmp_path, "kalibr_ds"))]) == 0
    text = capsys.readouterr().out
    assert re.search(r"\nkalibr_ds: within \d.\de-1\d px; readers: z > -w2", text)
    assert "\ncamodocal_scaramuzza: no, off by up to " in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--to basalt_sd", "did you mean basalt_ds?"),
        ("--to basalt_ucm", "not written: basalt_ucm: off by up to"),
        ("--to kalibr_equi --size 9", "WxH, such as 640x480"),
        ("--to kalibr_equi --field-of-view 300", "shows 0 to 2"),
        ("--camera cam7", "which has cam0"),
    ],
)
def test_mistake_is_one_line(
    words: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(["convert", str(write(tmp_path)), *words.split(), "--out", str(tmp_path)])
    except SystemExit as end:
        status = int(end.code or 0)
    assert status != 0
    assert message in capsys.readouterr().err
