"""The command line of `catoptra-studies compare`."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_studies.cameras import compare_command


def test_world_without_landmarks_is_compared_without_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--cameras", "paper", "--world", "incidence_rings", "--size", "60", "--frames", "1"]
    assert compare_command.main([*words, "--output", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "no landmarks" in printed
    assert (tmp_path / "comparison.csv").exists()


def test_unknown_world_ends_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--cameras", "paper", "--world", "moon", "--output", str(tmp_path)]
    assert compare_command.main(words) == 2
    assert "moon" in capsys.readouterr().err
