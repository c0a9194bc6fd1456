"""The command `catoptra-studies cameras`, and its gallery: numbers, pictures, page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from catoptra_studies.cameras import cameras_command


def test_gallery_has_a_picture_and_a_row_for_each_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--cameras", "paper,equidistant_220", "--size", "60", "--frames", "1"]
    assert cameras_command.main([*words, "--out", str(tmp_path)]) == 0
    assert "2/2" in capsys.readouterr().err
    paper, lens = json.loads((tmp_path / "cameras.json").read_text())
    assert [paper["name"], lens["name"]] == ["paper", "equidistant_220"]
    assert (tmp_path / "paper.png").exists()
    text = (tmp_path / "index.html").read_text()
    assert text.count("data:image/png") == 2
    assert "Miyamoto" in text
    # A mirror without a fold.
    assert paper["first_fold_deg"] is None
    assert (paper["central_beyond_m"], paper["covered_sphere"]) == (0.0, 0.75)


def test_unknown_camera_is_named_with_all_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cameras_command.main(["--cameras", "papr", "--out", str(tmp_path)])
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert "papr" in error
    assert "parabolic" in error
