"""Commands: each reaches its own parser and handles signals; libraries are the server's alone."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from catoptra_server.__main__ import main
from catoptra_server.commands import COMMANDS


def test_main_without_a_command_serves(capsys: pytest.CaptureFixture[str]) -> None:
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
    ("module", "words"),
    [
        ("commands.serve", []),
        ("commands.doctor.command", ["doctor"]),
        ("commands.explain", ["explain"]),
        ("commands.list", ["list"]),
    ],
)
def test_signals_are_handled_for_every_command(
    monkeypatch: pytest.MonkeyPatch, module: str, words: list[str]
) -> None:
    before = signal.getsignal(signal.SIGINT)
    within: list[object] = []

    def record(*_: object, **__: object) -> int:
        within.append(signal.getsignal(signal.SIGINT))
        return 3

    monkeypatch.setattr(f"catoptra_server.{module}.main", record)
    assert main(words) == 3
    assert within != [before]
    assert signal.getsignal(signal.SIGINT) == before


@pytest.mark.parametrize("command", COMMANDS)
def test_command_when_misspelt_is_named_with_all_commands(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command[:-1], "--json"])
    assert ended.value.code == 2
    line = capsys.readouterr().err
    assert f"no command {command[:-1]!r}: the commands are {', '.join(COMMANDS)}" in line
    assert f"did you mean {command}?" in line


def test_command_like_none_has_no_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["xyz"])
    assert "did you mean" not in capsys.readouterr().err


def test_main_with_version_prints_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    output = capsys.readouterr().out
    assert output.startswith("catoptra-server ")
    assert output.count("\n") == 1


def test_main_with_explain_explains(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["explain", "--help"])
    assert ended.value.code == 0
    assert "usage: catoptra-server explain" in capsys.readouterr().out
