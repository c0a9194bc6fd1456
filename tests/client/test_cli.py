"""Commands of the client: their options, and errors as one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_client.cli import main
from catoptra_client.training_frames import ROBOT_CLASS


@pytest.mark.parametrize("command", ["train", "bearings"])
def test_command_takes_any_class_of_robot(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    help_text = capsys.readouterr().out
    assert "--robot-class CLASS" in help_text
    assert ROBOT_CLASS in help_text


def test_error_is_one_line_and_status_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bearings", "--classifier", str(tmp_path / "none.npz")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("catoptra-client: ")
    assert "none.npz" in line
