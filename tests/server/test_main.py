"""The first word of the command line: it chooses the command, and loads nothing else."""

from __future__ import annotations

import subprocess
import sys

import pytest

from catoptra_server.__main__ import main


def test_command_when_no_word_is_given_serves(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert "--world FILE" in capsys.readouterr().out


def test_command_when_doctor_is_asked_for_examines(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["doctor", "--help"])
    assert ended.value.code == 0
    assert "usage: catoptra-server doctor" in capsys.readouterr().out


def test_doctor_when_it_starts_has_loaded_no_library_of_the_server() -> None:
    code = (
        "import sys; from catoptra_server.__main__ import main\n"
        "try: main(['doctor', '--help'])\n"
        "except SystemExit: pass\n"
        "sys.exit(any(name in sys.modules for name in ('numpy', 'zmq', 'cv2', 'trimesh')))"
    )
    ran = subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, check=False)
    assert ran.returncode == 0


def test_command_when_explain_is_asked_for_explains(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["explain", "--help"])
    assert ended.value.code == 0
    assert "usage: catoptra-server explain" in capsys.readouterr().out
