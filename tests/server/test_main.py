"""Subcommands: each reaches its own parser; signals and libraries are the server's alone."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from catoptra_server.__main__ import main


def test_main_without_a_subcommand_serves(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert "--world FILE" in capsys.readouterr().out


def test_main_with_doctor_checks(capsys: pytest.CaptureFixture[str]) -> None:
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
    process = subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, check=False)
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("module", "words", "handles_signals"),
    [
        ("cli", [], True),
        ("doctor.doctor_cli", ["doctor"], False),
        ("explain", ["explain"], False),
    ],
)
def test_signals_are_handled_for_the_server_alone(
    monkeypatch: pytest.MonkeyPatch, module: str, words: list[str], handles_signals: bool
) -> None:
    before = signal.getsignal(signal.SIGINT)
    within: list[object] = []

    def record(*_: object) -> int:
        within.append(signal.getsignal(signal.SIGINT))
        return 3

    monkeypatch.setattr(f"catoptra_server.{module}.main", record)
    assert main(words) == 3
    assert (within != [before]) == handles_signals
    assert signal.getsignal(signal.SIGINT) == before


def test_main_with_explain_explains(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["explain", "--help"])
    assert ended.value.code == 0
    assert "usage: catoptra-server explain" in capsys.readouterr().out
