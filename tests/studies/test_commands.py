from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_studies.commands import (
    add_output,
    make_parser,
    open_progress,
    parse_study,
    print_line,
    print_table,
)


def test_study_has_its_new_folder(tmp_path: Path) -> None:
    parser = make_parser("walk", "Walk.")
    add_output(parser, "out/walk", "folder of the walk")
    parse_study(parser, ["--out", str(tmp_path / "a" / "b")])
    assert (tmp_path / "a" / "b").is_dir()


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


def test_progress_when_interrupted_leaves_no_bars_in_a_pipe(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupt() -> None:
        with open_progress() as progress:
            progress.add_task("frames", 2)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupt()
    assert capsys.readouterr().err == ""


def test_line_when_printed_above_bars_goes_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with open_progress(is_visible=False) as progress:
        progress.print_line("sim: watch the drives at http://[::1]:5080/")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "sim: watch the drives at http://[::1]:5080/\n"
