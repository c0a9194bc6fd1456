"""Files of a camera in a folder, and the lines about them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from catoptra_protocol.calibration.calibration_folder import REPORT_NAME, write_calibration
from catoptra_protocol.calibration.exports import EXPORTS
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import PAPER


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
