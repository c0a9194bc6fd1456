"""The command `catoptra-studies`: its subcommands, and their need of a server."""

from __future__ import annotations

import subprocess
import sys

import pytest

from catoptra_studies.cli import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
def test_command_when_asked_for_help_prints_its_own(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert f"usage: catoptra-studies {command}" in capsys.readouterr().out


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    listed = capsys.readouterr().out
    assert all(f"  {command} " in listed for command in COMMANDS)


def test_command_when_interrupted_says_so_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("catoptra_studies.experiment.demo_command.main", interrupt)
    assert main(["demo"]) == 130
    assert capsys.readouterr().err == "catoptra-studies: interrupted\n"


# A None in sys.modules makes every import of that name fail, as if it were not installed.
WITHOUT_SERVER = """
import importlib.util, sys
find_spec = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: (
    None if name == "catoptra_server" else find_spec(name, *rest)
)
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "catoptra_server":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from catoptra_studies.cli import main
sys.exit(main(sys.argv[1:]))
"""


def run_without_server(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WITHOUT_SERVER, *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize("command", ["cost", "figures"])
def test_command_when_the_server_is_missing_names_the_extra_in_one_line(command: str) -> None:
    ended = run_without_server(command)
    assert ended.returncode == 1
    (line,) = ended.stderr.splitlines()
    assert "pip install 'catoptra-studies[server]'" in line


def test_demo_when_the_server_is_missing_starts_and_has_no_camera_figures() -> None:
    ended = run_without_server("demo", "--help")
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize("words", [("demo", "--runs", "1"), ("live",)])
def test_command_when_the_server_is_missing_and_must_be_started_names_it(words, tmp_path) -> None:
    ended = run_without_server(*words, "--out", str(tmp_path))
    assert ended.returncode == 1
    assert "pip install catoptra-server" in " ".join(ended.stderr.split())
