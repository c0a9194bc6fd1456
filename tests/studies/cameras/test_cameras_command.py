"""The command line of `catoptra-studies cameras`."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_studies.cameras import cameras_command


def test_gallery_of_one_camera_is_written(tmp_path: Path) -> None:
    words = ["--cameras", "parabolic", "--size", "60", "--frames", "1", "--output", str(tmp_path)]
    assert cameras_command.main(words) == 0
    assert (tmp_path / "index.html").exists()
    assert (tmp_path / "parabolic.png").exists()


def test_unknown_camera_is_named_with_all_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cameras_command.main(["--cameras", "papr", "--output", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "papr" in error
    assert "parabolic" in error
