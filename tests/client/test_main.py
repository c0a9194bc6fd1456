"""Ctrl-C ends each command with one line and status 130, also while its libraries are loaded."""

from __future__ import annotations

import subprocess
import sys

import pytest

import catoptra_client
from catoptra_client.__main__ import EXIT_INTERRUPTED, main


def test_command_when_interrupted_ends_with_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("catoptra_client.cli.main", interrupt)
    assert main(["train"]) == EXIT_INTERRUPTED
    assert capsys.readouterr().err == "catoptra-client: interrupted\n"


def test_entry_point_when_imported_has_loaded_no_library() -> None:
    code = (
        "import sys; import catoptra_client.__main__\n"
        "sys.exit(any(name in sys.modules for name in ('numpy', 'cv2', 'zmq')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_package_has_show_and_no_other_attribute() -> None:
    assert callable(catoptra_client.show)
    with pytest.raises(AttributeError, match="has no attribute 'shaw'"):
        _ = catoptra_client.shaw  # type: ignore[attr-defined]
