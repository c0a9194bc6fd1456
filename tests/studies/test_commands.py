from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.commands import (
    EXIT_FAILURE,
    add_output,
    make_parser,
    open_progress,
    print_line,
    print_table,
    run_study,
)


def parse_output(folder: Path) -> argparse.Namespace:
    parser = make_parser("walk", "Walk.")
    add_output(parser, "out/walk", "folder of the walk")
    return parser.parse_args(["--output", str(folder)])


def test_study_runs_in_its_new_folder_and_decides_the_status(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    assert run_study("walk", parse_output(folder), lambda _: 3 if folder.is_dir() else 0) == 3


@pytest.mark.parametrize("kind", [CatoptraError, OSError])
def test_study_that_cannot_be_done_ends_with_one_line(
    kind: type[Exception], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: argparse.Namespace) -> int:
        raise kind("[red]no.ini[/red]")

    assert run_study("walk", parse_output(tmp_path), fail) == EXIT_FAILURE
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "walk: [red]no.ini[/red]\n")


def test_line_when_printed_keeps_brackets(capsys: pytest.CaptureFixture[str]) -> None:
    print_line("pip install 'catoptra-studies[server]'")
    assert "catoptra-studies[server]" in capsys.readouterr().out


def test_table_when_printed_ends_rows_with_the_answer(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(("claim", "measured", "confirmed"), [("a", "1", "yes"), ("b", "2", "not decided")])
    printed = capsys.readouterr().out
    assert "yes" in printed
    assert "not decided" in printed


def test_progress_when_hidden_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with open_progress(is_visible=False) as progress:
        advance = progress.add_task("frames", 2)
        advance()
        advance()
    assert capsys.readouterr().err == ""


def test_line_when_printed_above_bars_goes_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with open_progress(is_visible=False) as progress:
        progress.print_line("sim: watch the drives at http://[::1]:5080/")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "sim: watch the drives at http://[::1]:5080/\n"
